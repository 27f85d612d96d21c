#version 330
uniform sampler2D atlas;
// The logarithm of COARSE_TEXELS_PER_PX in render.py: from there on coarser levels set in smoothly.
const float level_bias = -1.6;
in vec2 uv;
in float opacity;
in float light;
out vec4 colour;

void main() {
    // Skin that the still picture stands for (opacity 0) hides the inside of the head all the same.
    colour = vec4(texture(atlas, uv, level_bias).rgb * light, opacity);
}
