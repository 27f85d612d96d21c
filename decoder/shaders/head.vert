#version 330
uniform mat4 clip_from_head;
uniform float mouth_shading;
uniform bool texture_is_shaded;
in vec3 position_mm;
in vec2 texture_coordinate;
in float vertex_opacity;
in float inside_mouth;
in float teeth_falloff;
out vec2 uv;
out float opacity;
out float light;

void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    light = texture_is_shaded ? 1.0 : teeth_falloff * mix(1.0, mouth_shading, inside_mouth);
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
}
