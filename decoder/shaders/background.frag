#version 330
uniform sampler2D picture;
// What is added to the picture, 128 more than it is.
uniform sampler2D change;
uniform bool changes;
in vec2 uv;
out vec4 colour;

void main() {
    // The alpha of a picture without one is 1.
    colour = texture(picture, uv);
    if (changes) {
        colour.rgb = clamp(colour.rgb + texture(change, uv).rgb - 128.0 / 255.0, 0.0, 1.0);
    }
}
