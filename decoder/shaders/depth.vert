#version 330
uniform mat4 clip_from_head;
in vec3 position_mm;

void main() {
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
}
