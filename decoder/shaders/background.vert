#version 330
uniform vec2 picture_px;
in vec2 position_px;
in vec2 texture_coordinate;
out vec2 uv;

void main() {
    uv = texture_coordinate;
    gl_Position = vec4((2.0 * position_px + 1.0) / picture_px - 1.0, 0.0, 1.0);
}
