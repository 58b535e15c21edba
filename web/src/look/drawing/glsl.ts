import {
  CONSTANTS,
  COSINE,
  KEYS_WEIGHTS,
  QUARTER_TURNS,
  REMAINDER,
  SINE,
  UNIFORMS,
} from "./shader_inputs";

/** Shader in GLSL: direction of a view pixel, its position in the image, and the colour. `wgsl.ts` contains the same functions in the same order. */

export const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const COS_SIN = `
vec2 cos_sin(float x) {
  float k = ${QUARTER_TURNS};
  float r = ${REMAINDER};
  float q = r * r;
  float s = ${SINE};
  float c = ${COSINE};
  int turn = int(k) & 3;
  vec2 swapped = (turn & 1) == 1 ? vec2(-s, c) : vec2(c, s);
  return turn < 2 ? swapped : -swapped;
}`;

const TARGET = `
// As in omnimirror.dewarp.screens: vector in the world frame, in mm for a finite screen.
vec3 world_vector(vec2 p, out bool inside) {
  inside = true;
  vec2 q = p - (size - 1.0) / 2.0;
  float far = distance_mm > 0.0 ? distance_mm : 1.0;
  if (shape == 0) {
    float pan = numbers.x + ((p.x + 0.5) / size.x - 0.5) * numbers.y;
    float tilt = numbers.w - (p.y + 0.5) / size.y * (numbers.w - numbers.z);
    vec2 around = cos_sin(pan), up = cos_sin(tilt);
    vec3 d = vec3(up.x * around.x, -up.x * around.y, up.y);
    return distance_mm > 0.0 ? d * (far / max(up.x, 1e-6)) : d;
  }
  if (shape == 1) return far * (axes * vec3(1.0, q / numbers.x));
  if (shape == 4) return vec3(0.0, 0.0, -numbers.y) + axes * vec3(0.0, numbers.x * q);
  float radius = length(q);
  if (shape == 2) {
    inside = radius <= numbers.y;
    vec2 omega = cos_sin(radius * numbers.x);
    float sideways = radius > 0.0 ? omega.y / radius : numbers.x;
    return far * (axes * vec3(omega.x, sideways * q));
  }
  float t = radius * numbers.x;
  float k = 1.0 / (1.0 + t * t);
  return far * (axes * vec3((1.0 - t * t) * k, 2.0 * numbers.x * k * q));
}`;

const KERNEL = `
// Bicubic kernel of Keys.
vec4 weights(float t, float a) {
  float x = 1.0 + t, y = 1.0 - t, z = 2.0 - t;
  return vec4(${KEYS_WEIGHTS});
}`;

const PROJECTION = `
// As in omnimirror.dewarp._source_coordinates, over s = sin(Omega/2).
vec2 half_angle(float across, float along) {
  float len = max(length(vec2(across, along)), 1e-20);
  float more = sqrt((len + abs(along)) / (2.0 * len));
  float less = abs(across) / (2.0 * len * more);
  bool ahead = along > 0.0;
  float sine = ahead ? less : more;
  if (across < 0.0) sine = ahead ? -less : 2.0 - more;
  return vec2(sine, ahead ? more : less);
}

// Values of the table cell of s and their derivatives; extrapolated beyond both ends.
void cell(float s, out vec3 value, out vec3 rate) {
  int last = textureSize(radii, 0).x - 1;
  float per = float(last) / (ends.y - ends.x);
  float place = (s - ends.x) * per;
  int i = int(clamp(floor(place), 0.0, float(last - 1)));
  vec3 a = texelFetch(radii, ivec2(i, 0), 0).xyz, b = texelFetch(radii, ivec2(i + 1, 0), 0).xyz;
  value = mix(a, b, place - float(i));
  rate = (b - a) * per;
}

float solve(float across, float along) {
  vec3 value, rate;
  float s = clamp(half_angle(across, along - eye).x, ends.x, ends.y);
  for (int i = 0; i < 6; i++) {
    cell(s, value, rate);
    vec2 d = vec2(across, along) - value.yz;
    vec2 half_ = half_angle(d.x, d.y);
    float slope = 1.0 - 0.5 * half_.y * (d.x * rate.z - d.y * rate.y) / dot(d, d);
    s = clamp(s - (s - half_.x) / slope, 2.0 * ends.x - ends.y, 2.0 * ends.y - ends.x);
  }
  return s;
}

float limit_at(vec2 azimuth) {
  int n = textureSize(limits, 0).x;
  float place = fract(atan(azimuth.y, azimuth.x) / 6.283185307179586 + 1.0) * float(n);
  int i = int(place) % n;
  return mix(texelFetch(limits, ivec2(i, 0), 0).x, texelFetch(limits, ivec2((i + 1) % n, 0), 0).x, fract(place));
}

// Lattice node before a point of the disc, and the offset from it.
vec2 lattice_cell(sampler2D nodes, vec2 p, out ivec2 before) {
  int n = textureSize(nodes, 0).x;
  vec2 place = (p / ends.y + 1.0) / 2.0 * float(n - 1);
  before = ivec2(clamp(floor(place), 0.0, float(n - 2)));
  return place - vec2(before);
}

// Bilinear interpolation of the lattice.
vec3 bilinear(sampler2D nodes, vec2 p) {
  ivec2 i;
  vec2 f = lattice_cell(nodes, p, i);
  vec3 low = mix(texelFetch(nodes, i, 0).xyz, texelFetch(nodes, i + ivec2(1, 0), 0).xyz, f.x);
  vec3 high = mix(texelFetch(nodes, i + ivec2(0, 1), 0).xyz, texelFetch(nodes, i + ivec2(1, 1), 0).xyz, f.x);
  return mix(low, high, f.y);
}

// Bicubic interpolation; bilinear errors reach 0.1 px near the rim.
vec3 bicubic(sampler2D nodes, vec2 p) {
  ivec2 i, last = textureSize(nodes, 0) - 1;
  vec2 f = lattice_cell(nodes, p, i);
  vec4 wx = weights(f.x, KEYS_A_LATTICE), wy = weights(f.y, KEYS_A_LATTICE);
  vec3 total = vec3(0.0);
  for (int j = 0; j < 4; j++)
    for (int k = 0; k < 4; k++)
      total += wy[j] * wx[k] * texelFetch(nodes, clamp(i + ivec2(k - 1, j - 1), ivec2(0), last), 0).xyz;
  return total;
}

// Azimuth and s of a vector (axis, right, down).
float polar(vec3 t, out vec2 azimuth) {
  float across = length(t.yz);
  azimuth = across > 0.0 ? t.yz / across : vec2(1.0, 0.0);
  return half_angle(across, t.x).x;
}

// The same for a point, with the ray origin of a camera without rotational symmetry.
float solve_without_symmetry(vec3 t, out vec2 azimuth) {
  azimuth = vec2(1.0, 0.0);
  float s = 0.0;
  for (int i = 0; i < ROUGH_STEPS; i++) s = polar(t - bilinear(starts, min(s, ends.y) * azimuth), azimuth);
  for (int i = 0; i < FINE_STEPS; i++) s = polar(t - bicubic(starts, min(s, ends.y) * azimuth), azimuth);
  return s;
}

vec2 project(vec3 world, out bool visible) {
  vec3 t = frame * world;
  vec2 azimuth;
  float s = is_point && has_starts ? solve_without_symmetry(t, azimuth) : polar(t, azimuth);
  if (is_point && has_origins) s = solve(length(t.yz), t.x);
  vec2 offset;
  if (has_lattice) {
    float end = limit_at(azimuth);
    visible = s <= end;
    offset = bicubic(lattice, min(s, end + 2.0 * ends.y / float(textureSize(lattice, 0).x)) * azimuth).xy - own_centre;
  } else {
    visible = s >= ends.x - 1e-6 && s <= ends.y + 1e-6;
    vec3 value, rate;
    cell(s, value, rate);
    offset = max(value.x, 0.0) * azimuth;
  }
  vec2 pixel = centre + scale * offset;
  visible = visible && all(greaterThanEqual(pixel, vec2(-0.5))) && all(lessThanEqual(pixel, image_size - 0.5));
  return pixel;
}`;

const SAMPLING = `
vec3 texel(ivec2 p) {
  return texelFetch(image, clamp(p, ivec2(0), textureSize(image, 0) - 1), 0).rgb;
}

vec3 cubic(vec2 p) {
  vec2 stored_size = vec2(textureSize(image, 0)); // smaller for images above the texture limit
  if (stored_size != image_size) p = (p + 0.5) * stored_size / image_size - 0.5;
  ivec2 i = ivec2(floor(p));
  vec4 wx = weights(p.x - float(i.x), KEYS_A), wy = weights(p.y - float(i.y), KEYS_A);
  vec3 total = vec3(0.0);
  for (int j = 0; j < 4; j++) {
    vec3 row = vec3(0.0);
    for (int k = 0; k < 4; k++) row += wx[k] * texel(i + ivec2(k - 1, j - 1));
    total += wy[j] * row;
  }
  return clamp(total, 0.0, 1.0);
}

float sharpness_scale(float side) {
  return 1.0 - pow(SHARP / max(side, SHARP), 8.0);
}

int taps(float side) {
  return side > SHARP ? int(clamp(ceil(side * sharpness_scale(side) / SPACING), 2.0, float(MAX_TAPS))) : 1;
}

// Whether the field contains a point: for cameras with an axis, between two radii.
bool is_in_field(vec2 p) {
  if (any(lessThan(p, vec2(-0.5))) || any(greaterThan(p, image_size - 0.5))) return false;
  if (has_lattice) return true;
  float r = length(p - centre) / scale;
  return r >= texelFetch(radii, ivec2(0), 0).x - 1e-3 && r <= texelFetch(radii, ivec2(textureSize(radii, 0).x - 1, 0), 0).x + 1e-3;
}

// Mean over the footprint of the pixel, a parallelogram; with fewer, bilinear samples while the view moves.
vec3 mean(vec2 p, vec2 right, vec2 down, bool rough) {
  float across = length(right), along = length(down);
  int n = taps(across), m = taps(along);
  if (n * m == 1) return cubic(p);
  right *= sharpness_scale(across);
  down *= sharpness_scale(along);
  vec3 total = vec3(0.0);
  float count = 0.0;
  for (int j = 0; j < m; j++)
    for (int k = 0; k < n; k++) {
      vec2 at = p + ((float(k) + 0.5) / float(n) - 0.5) * right + ((float(j) + 0.5) / float(m) - 0.5) * down;
      if (!is_in_field(at)) continue;
      total += rough ? texture(image, (at + 0.5) / image_size).rgb : cubic(at);
      count += 1.0;
    }
  return count > 0.0 ? total / count : cubic(p);
}`;

const declarations = [
  ...Object.entries(UNIFORMS).map(([name, type]) => `uniform ${type} ${name};`),
  ...Object.entries(CONSTANTS.integers).map(([name, value]) => `const int ${name} = ${value};`),
  ...Object.entries(CONSTANTS.numbers).map(([name, value]) => `const float ${name} = ${value};`),
].join("\n");

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D image, radii, lattice, limits, starts;
${declarations}
out vec4 colour;
${COS_SIN}
${TARGET}
${KERNEL}
${PROJECTION}
${SAMPLING}

void main() {
  vec2 p = gl_FragCoord.xy - corner;
  p = vec2(p.x - 0.5, size.y - p.y - 0.5);
  bool inside, visible;
  vec2 at = project(world_vector(p, inside), visible);
  vec2 right = dFdx(at), down = -dFdy(at);
  visible = visible && inside;
  if (wants_coordinates) {
    colour = vec4(at, visible ? 1.0 : 0.0, 1.0);
    return;
  }
  if (!visible) {
    colour = vec4(0.0);
    return;
  }
  colour = vec4(mean(at, right, down, is_preview), 1.0);
}`;
