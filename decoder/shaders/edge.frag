#version 330
uniform sampler2D atlas;
// How far beyond the edge of the head its colours reach, pixels.
uniform float reach_px;
// See head.frag.
const float level_bias = -1.6;
in vec2 uv;
in float opacity;
in float light;
in float distance_px;
out vec4 colour;

void main() {
    float coverage = clamp(reach_px - distance_px, 0.0, 1.0);
    colour = vec4(texture(atlas, uv, level_bias).rgb * light, opacity * coverage);
}
