import bpy
op = bpy.context.active_operator

op.time = 64.0
op.steady_state = False
op.smoothing_passes = 1
op.channels = 'luminance'
op.sampling = 'nearest'
op.gutter = 2
op.background = 'keep'
op.alpha = 'auto'
op.content = 'values'
op.vertex_group = ''
op.invert_mask = False
op.selected_only = True
op.mask_image = ''
op.output = 'NEW'
op.assign = True
