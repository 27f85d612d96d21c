// The programs of `decoder/shaders`, in the language of WebGL 2.

const HEADER = "#version 300 es\nprecision highp float;\n";
/** Positions are those of a picture, whose first row is at its top. */
const UPWARDS = "gl_Position.y = -gl_Position.y;";

/** The head in its texture; transparent skin hides the inside by its depth. */
export const HEAD = {
  vertex: `${HEADER}
uniform mat4 clip_from_head;
uniform float mouth_shading;
uniform bool texture_is_shaded;
in vec3 position_mm;
in vec2 texture_coordinate;
in float vertex_opacity;
in float inside_mouth;
in float teeth_falloff;
out vec2 uv;
out float opacity;
out float light;
void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    light = texture_is_shaded ? 1.0 : teeth_falloff * mix(1.0, mouth_shading, inside_mouth);
    gl_Position = clip_from_head * vec4(position_mm, 1.0);
    ${UPWARDS}
}`,
  // The bias is - log2(COARSE_TEXELS_PER_PX) of renderer.js.
  fragment: `${HEADER}
uniform sampler2D atlas;
in vec2 uv;
in float opacity;
in float light;
out vec4 colour;
void main() {
    colour = vec4(texture(atlas, uv, -1.6).rgb * light, opacity);
}`,
};

/** The strips at the edges of the head. */
export const EDGE = {
  vertex: `${HEADER}
uniform bool behind_head;
const float far_depth = 0.99;
in vec3 position_clip;
in vec2 texture_coordinate;
in float vertex_opacity;
in float vertex_light;
in float vertex_distance_px;
out vec2 uv;
out float opacity;
out float light;
out float distance_px;
void main() {
    uv = texture_coordinate;
    opacity = vertex_opacity;
    light = vertex_light;
    distance_px = vertex_distance_px;
    gl_Position = vec4(position_clip.xy, behind_head ? far_depth : position_clip.z, 1.0);
    ${UPWARDS}
}`,
  fragment: `${HEADER}
uniform sampler2D atlas;
uniform float reach_px;
in vec2 uv;
in float opacity;
in float light;
in float distance_px;
out vec4 colour;
void main() {
    float coverage = clamp(reach_px - distance_px, 0.0, 1.0);
    colour = vec4(texture(atlas, uv, -1.6).rgb * light, opacity * coverage);
}`,
};

const BACKGROUND_VERTEX = `${HEADER}
uniform vec2 picture_px;
uniform float depth;
// The same ones in all programs of layers.
layout(location = 0) in vec2 position_px;
layout(location = 1) in vec2 texture_coordinate;
out vec2 uv;
void main() {
    uv = texture_coordinate;
    gl_Position = vec4((2.0 * position_px + 1.0) / picture_px - 1.0, depth, 1.0);
    ${UPWARDS}
}`;

const LAYER = `
uniform sampler2D picture;
// What is added to its colours, 128 grey levels more than that.
uniform sampler2D change;
// Light: colours v become gain v + offset.
uniform vec2 light;
in vec2 uv;
out vec4 colour;
vec4 layer(vec2 at, vec4 own) {
#ifdef CHANGED
    own.rgb = clamp(own.rgb + textureLod(change, at, 0.0).rgb - 128.0 / 255.0, 0.0, 1.0);
#endif
#ifdef LIT
    own.rgb = light.x * own.rgb + light.y;
#endif
    return own;
}
`;

/** What may be done to the colours of layers; a program is found by the sum of what is. */
export const CHANGED = 1;
export const LIT = 2;

/**
 * The programs of layers, by whether their colours change and have a light of their own: software
 * takes time for what it need not do.
 * @param {string} main
 */
function layerPrograms(main) {
  const looks = ["", "#define CHANGED\n", "#define LIT\n", "#define CHANGED\n#define LIT\n"];
  return looks.map((look) => ({
    vertex: BACKGROUND_VERTEX,
    fragment: `${HEADER}${look}${LAYER}${main}`,
  }));
}

/** Layers behind the head. */
export const BACKGROUND = layerPrograms(`
void main() {
    colour = layer(uv, textureLod(picture, uv, 0.0));
}`);

/** The scene where it does not move: at the pixels themselves, whatever cells it is drawn in. */
export const STILL_SCENE = layerPrograms(`
uniform vec2 picture_px;
void main() {
    vec2 at = vec2(gl_FragCoord.x, picture_px.y - gl_FragCoord.y) / picture_px;
    colour = layer(at, textureLod(picture, at, 0.0));
}`);

/** The scene where it was never seen: as in a mirror at its edge, the more blurred the farther. */
export const UNSEEN_SCENE = layerPrograms(`
uniform float fade;
const float MOST_BLURRED = 5.0;
void main() {
    vec2 beyond = max(abs(uv - 0.5) - 0.5, 0.0);
    float away = max(beyond.x, beyond.y);
    vec2 mirrored = 1.0 - abs(1.0 - mod(uv, 2.0));
    colour = layer(mirrored, textureLod(picture, mirrored, MOST_BLURRED * min(away / fade, 1.0)));
}`);
