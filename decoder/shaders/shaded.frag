#version 330
in vec3 normal;
in vec3 albedo;
out vec4 colour;

// Camera axes: the key light stands above and left of a camera that lights faintly itself.
const vec3 to_light = vec3(-0.36, -0.48, -0.80);

void main() {
    vec3 n = normalize(normal);
    float light = 0.28 + 0.5 * max(dot(n, to_light), 0.0) + 0.22 * max(-n.z, 0.0);
    colour = vec4(albedo * light, 1.0);
}
