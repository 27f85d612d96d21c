#version 330
uniform sampler2D atlas;
in vec2 uv;
in float opacity;
out vec4 colour;

void main() {
    // What cannot be seen must not hide what lies behind it either.
    if (opacity < 0.002) discard;
    colour = vec4(texture(atlas, uv).rgb, opacity);
}
