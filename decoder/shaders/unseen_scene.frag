#version 330
uniform sampler2D picture;
// How far beyond its edge the scene is as blurred as can be, in its sides.
uniform float fade;
// Mipmap level of what is as blurred as can be.
uniform float most_blurred;
in vec2 uv;
out vec4 colour;

void main() {
    vec2 beyond = max(abs(uv - 0.5) - 0.5, 0.0);
    float away = max(beyond.x, beyond.y);
    // What was never seen: the scene as in a mirror at its edge, the more blurred the farther.
    vec2 mirrored = 1.0 - abs(1.0 - mod(uv, 2.0));
    colour = textureLod(picture, mirrored, most_blurred * min(away / fade, 1.0));
}
