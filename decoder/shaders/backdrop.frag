#version 330
uniform sampler2D still;
in vec2 uv;
out vec4 colour;

void main() {
    colour = vec4(texture(still, uv).rgb, 1.0);
}
