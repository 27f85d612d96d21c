#version 330
uniform mat4 clip_from_head;
uniform mat3 camera_from_head;
in vec3 position_mm;
in vec3 normal_head;
in vec3 vertex_colour;
out vec3 normal;
out vec3 albedo;

void main() {
    normal = camera_from_head * normal_head;
    albedo = vertex_colour;
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
}
