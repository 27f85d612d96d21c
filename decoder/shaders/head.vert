#version 330
uniform mat4 clip_from_head;
in vec3 position_mm;
in vec2 texture_coordinate;
in float vertex_opacity;
out vec2 uv;
out float opacity;

void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
}
