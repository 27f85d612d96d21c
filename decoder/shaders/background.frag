#version 330
uniform sampler2D picture;
// Of a scene that has mipmaps: how far beyond its edge it is as blurred as can be, in its sides;
// 0: of a picture without.
uniform float fade;
in vec2 uv;
out vec4 colour;

const float MOST_BLURRED = 5.0;

void main() {
    vec2 beyond = max(abs(uv - 0.5) - 0.5, 0.0);
    float away = max(beyond.x, beyond.y);
    if (fade == 0.0 || away == 0.0) {
        colour = textureLod(picture, uv, 0.0);
        return;
    }
    // What was never seen: the scene as in a mirror at its edge, the more blurred the farther.
    vec2 mirrored = 1.0 - abs(1.0 - mod(uv, 2.0));
    colour = textureLod(picture, mirrored, MOST_BLURRED * min(away / fade, 1.0));
}
