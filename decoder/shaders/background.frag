#version 330
uniform sampler2D picture;
#ifdef ADDS
// What is added to the picture, 128 more than it is.
uniform sampler2D change;
uniform bool changes;
// How much more than 1 the gain of all colours is, around the grey level 128; and what is added.
uniform vec2 light;
#endif
in vec2 uv;
out vec4 colour;

void main() {
    // The alpha of a picture without one is 1.
    colour = texture(picture, uv);
#ifdef ADDS
    if (changes) {
        colour.rgb += texture(change, uv).rgb - 128.0 / 255.0;
    }
    colour.rgb = clamp(colour.rgb, 0.0, 1.0);
    colour.rgb = clamp(colour.rgb + light.x * (colour.rgb - 128.0 / 255.0) + light.y, 0.0, 1.0);
#endif
}
