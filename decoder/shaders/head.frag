#version 330
uniform sampler2D atlas;
in vec2 uv;
in float opacity;
out vec4 colour;

void main() {
    // Where the still picture stands for the skin (opacity 0) the skin hides what is inside it all the same.
    colour = vec4(texture(atlas, uv).rgb, opacity);
}
