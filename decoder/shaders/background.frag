#version 330
uniform sampler2D picture;
in vec2 uv;
out vec4 colour;

void main() {
    colour = textureLod(picture, uv, 0.0);
}
