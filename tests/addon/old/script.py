import bpy

bpy.ops.shock_filter.sharpen_image(image="Photo", time=64.0, smoothing_passes=3, output="NEW")
bpy.ops.shock_filter.sharpen_texture(image="Wood", time=256.0, gutter=2, assign=False)
bpy.ops.shock_filter.sharpen_colors(time=1024.0, channels="luminance")
