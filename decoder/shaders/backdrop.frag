#version 330
uniform sampler2D still;
in vec2 uv;
out vec4 colour;

void main() {
    // Of a picture without opacity this is 1.
    colour = texture(still, uv);
}
