#version 330
uniform bool behind_head;
// Depth in clip coordinates of what is behind all of the head.
const float far_depth = 0.99999;
in vec3 position_clip;
in vec2 texture_coordinate;
in float vertex_opacity;
in float vertex_light;
in float vertex_distance_px;
out vec2 uv;
out float opacity;
out float light;
out float distance_px;

void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    light = vertex_light;
    distance_px = vertex_distance_px;
    gl_Position = vec4(position_clip.xy, behind_head ? far_depth : position_clip.z, 1.0);
}
