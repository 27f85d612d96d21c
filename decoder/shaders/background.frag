#version 330
uniform sampler2D picture;
in vec2 uv;
out vec4 colour;

void main() {
    // The alpha of a picture without one is 1.
    colour = texture(picture, uv);
}
