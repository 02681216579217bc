# SPDX-License-Identifier: GPL-3.0-or-later
"""Each filter on files, as its command runs it."""

from functools import partial

from shock_filter.core.files.images import filter_image_file
from shock_filter.core.files.meshes import filter_colors_file, filter_mesh_file
from shock_filter.core.files.output import Options
from shock_filter.core.files.textures import filter_texture_file
from shock_filter.core.registry import find


def _on_files(pipeline, name, places=2):
    def run(*files_and_settings, sharpen_time=None, **words):
        files, given = files_and_settings[:places], files_and_settings[places:]
        row = find(name)
        settings = given[0] if given else row.settings()
        function = partial(row.function(sharpen_time), settings=settings)
        return pipeline(function, *files, Options(**words))

    return run


sharpen_file = _on_files(filter_mesh_file, "sharpen_geometry")
denoise_file = _on_files(filter_mesh_file, "denoise_geometry")
sharpen_colors_file = _on_files(filter_colors_file, "sharpen_vertex_signal")
denoise_colors_file = _on_files(filter_colors_file, "beltrami_vertex_signal")
sharpen_image_file = _on_files(filter_image_file, "sharpen_image")
denoise_image_file = _on_files(filter_image_file, "beltrami_image")
sharpen_texture_file = _on_files(filter_texture_file, "sharpen_texture", places=3)
denoise_texture_file = _on_files(filter_texture_file, "beltrami_texture", places=3)
dilate_texture_file = _on_files(filter_texture_file, "dilate_texture", places=3)
