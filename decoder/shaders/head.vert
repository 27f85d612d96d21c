#version 330
uniform mat4 clip_from_head;
uniform float mouth_light;
uniform bool painted_light;
in vec3 position_mm;
in vec2 texture_coordinate;
in float vertex_opacity;
in float inside_mouth;
in float fading;
out vec2 uv;
out float opacity;
out float light;

void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    light = painted_light ? 1.0 : fading * mix(1.0, mouth_light, inside_mouth);
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
}
