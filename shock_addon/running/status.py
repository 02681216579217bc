# SPDX-License-Identifier: GPL-3.0-or-later
"""A line in the status bar while a job runs."""

from __future__ import annotations

import bpy


class StatusText:
    """A line in the status bars of all windows, and optionally in the header of an area."""

    def __init__(self) -> None:
        self._text = ""
        self._told: set[int] = set()
        self._in_header = False

    def show(
        self, context: bpy.types.Context, text: str, area: bpy.types.Area | None = None
    ) -> bool:
        """Show the line if it is new, or if a visible workspace does not show it yet.

        Parameters
        ----------
        context : bpy.types.Context
        text : str
        area : bpy.types.Area, optional
            Its header shows the line, too.

        Returns
        -------
        bool
            Whether the line was drawn, which can be slow.
        """
        windows = context.window_manager.windows
        seen = {window.workspace.session_uid for window in windows}
        if text == self._text and seen <= self._told:
            return False
        self._text = text
        self._told |= seen
        for window in windows:
            _set(window, window.workspace, text)
        if area is not None:
            self._in_header = True
            area.header_text_set(text)
        return True

    def clear(self, context: bpy.types.Context) -> None:
        """Remove the line from all windows and workspaces."""
        if context.window in list(context.window_manager.windows):
            self._clear()
        else:  # a window that closes; Blender crashes if the context is overridden meanwhile
            bpy.app.timers.register(self._clear, persistent=True)

    def _clear(self) -> None:
        for window in bpy.context.window_manager.windows:
            for workspace in bpy.data.workspaces:
                if workspace.session_uid in self._told:
                    _set(window, workspace, None)
        for screen in bpy.data.screens if self._in_header else []:
            for area in screen.areas:
                area.header_text_set(None)


def _set(window: bpy.types.Window, workspace: bpy.types.WorkSpace, text: str | None) -> None:
    # Blender sets the text of the context's workspace, and redraws the context's window, whose
    # workspace counts if both are given at once.
    override = bpy.context.temp_override
    with override(window=window), override(workspace=workspace):
        workspace.status_text_set(text)
