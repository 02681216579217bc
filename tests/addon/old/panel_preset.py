import bpy
settings = bpy.context.scene.shock_filter.image

settings.time = 256.0
settings.steady_state = False
settings.smoothing_passes = 2
settings.channels = 'luminance'
settings.sampling = 'nearest'
settings.scheme = 'fixed'
settings.alpha = 'auto'
settings.output = 'NEW'
