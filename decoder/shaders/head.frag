#version 330
uniform sampler2D atlas;
// - log2(COARSE_TEXELS_PER_PX) of renderer.py: coarser mipmap levels begin smoothly from there on.
const float level_bias = -1.6;
in vec2 uv;
in float opacity;
in float light;
out vec4 colour;

void main() {
    // Transparent skin (opacity 0), where the background shows the head, hides the inside by its depth.
    colour = vec4(texture(atlas, uv, level_bias).rgb * light, opacity);
}
