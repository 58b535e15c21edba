import {
  CONSTANTS,
  COSINE,
  KEYS_WEIGHTS,
  QUARTER_TURNS,
  REMAINDER,
  SINE,
  UNIFORMS,
} from "./shader_inputs";

/** Shader in WGSL: the functions of `glsl.ts` in the same order, with the uniforms as members of `u`. As with WebGL2, rows are drawn from the bottom. */

const TYPES = {
  mat3: "mat3x3f",
  vec4: "vec4f",
  vec2: "vec2f",
  float: "f32",
  int: "i32",
  bool: "u32", // buffers do not contain booleans
} as const;

const VERTEX = `
@vertex fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  let corner = vec2f(select(-1.0, 3.0, index == 1u), select(-1.0, 3.0, index == 2u));
  return vec4f(corner, 0.0, 1.0);
}`;

const COS_SIN = `
fn cos_sin(x: f32) -> vec2f {
  let k = ${QUARTER_TURNS};
  let r = ${REMAINDER};
  let q = r * r;
  let s = ${SINE};
  let c = ${COSINE};
  let turn = i32(k) & 3;
  let swapped = select(vec2f(c, s), vec2f(-s, c), (turn & 1) == 1);
  return select(-swapped, swapped, turn < 2);
}`;

const TARGET = `
// As in omnimirror.dewarp.screens: vector in the world frame, in mm for a finite screen.
fn world_vector(p: vec2f, inside: ptr<function, bool>) -> vec3f {
  *inside = true;
  let q = p - (u.size - 1.0) / 2.0;
  let far = select(1.0, u.distance_mm, u.distance_mm > 0.0);
  if (u.shape == 0) {
    let pan = u.numbers.x + ((p.x + 0.5) / u.size.x - 0.5) * u.numbers.y;
    let tilt = u.numbers.w - (p.y + 0.5) / u.size.y * (u.numbers.w - u.numbers.z);
    let around = cos_sin(pan);
    let up = cos_sin(tilt);
    let d = vec3f(up.x * around.x, -up.x * around.y, up.y);
    return select(d, d * (far / max(up.x, 1e-6)), u.distance_mm > 0.0);
  }
  if (u.shape == 1) { return far * (u.axes * vec3f(1.0, q / u.numbers.x)); }
  if (u.shape == 4) { return vec3f(0.0, 0.0, -u.numbers.y) + u.axes * vec3f(0.0, u.numbers.x * q); }
  let radius = length(q);
  if (u.shape == 2) {
    *inside = radius <= u.numbers.y;
    let omega = cos_sin(radius * u.numbers.x);
    let sideways = select(u.numbers.x, omega.y / radius, radius > 0.0);
    return far * (u.axes * vec3f(omega.x, sideways * q));
  }
  let t = radius * u.numbers.x;
  let k = 1.0 / (1.0 + t * t);
  return far * (u.axes * vec3f((1.0 - t * t) * k, 2.0 * u.numbers.x * k * q));
}`;

const KERNEL = `
// Bicubic kernel of Keys.
fn weights(t: f32, a: f32) -> vec4f {
  let x = 1.0 + t;
  let y = 1.0 - t;
  let z = 2.0 - t;
  return vec4f(${KEYS_WEIGHTS});
}`;

const PROJECTION = `
// As in omnimirror.dewarp._source_coordinates, over s = sin(Omega/2).
fn half_angle(across: f32, along: f32) -> vec2f {
  let len = max(length(vec2f(across, along)), 1e-20);
  let more = sqrt((len + abs(along)) / (2.0 * len));
  let less = abs(across) / (2.0 * len * more);
  let ahead = along > 0.0;
  var sine = select(more, less, ahead);
  if (across < 0.0) { sine = select(2.0 - more, -less, ahead); }
  return vec2f(sine, select(less, more, ahead));
}

// Values of the table cell of s and their derivatives; extrapolated beyond both ends.
fn cell(s: f32, value: ptr<function, vec3f>, rate: ptr<function, vec3f>) {
  let last = i32(textureDimensions(radii).x) - 1;
  let per = f32(last) / (u.ends.y - u.ends.x);
  let place = (s - u.ends.x) * per;
  let i = i32(clamp(floor(place), 0.0, f32(last - 1)));
  let a = textureLoad(radii, vec2i(i, 0), 0).xyz;
  let b = textureLoad(radii, vec2i(i + 1, 0), 0).xyz;
  *value = mix(a, b, place - f32(i));
  *rate = (b - a) * per;
}

fn solve(across: f32, along: f32) -> f32 {
  var value: vec3f;
  var rate: vec3f;
  var s = clamp(half_angle(across, along - u.eye).x, u.ends.x, u.ends.y);
  for (var i = 0; i < 6; i++) {
    cell(s, &value, &rate);
    let d = vec2f(across, along) - value.yz;
    let half_ = half_angle(d.x, d.y);
    let slope = 1.0 - 0.5 * half_.y * (d.x * rate.z - d.y * rate.y) / dot(d, d);
    s = clamp(s - (s - half_.x) / slope, 2.0 * u.ends.x - u.ends.y, 2.0 * u.ends.y - u.ends.x);
  }
  return s;
}

fn limit_at(azimuth: vec2f) -> f32 {
  let n = i32(textureDimensions(limits).x);
  let place = fract(atan2(azimuth.y, azimuth.x) / 6.283185307179586 + 1.0) * f32(n);
  let i = i32(place) % n;
  return mix(textureLoad(limits, vec2i(i, 0), 0).x, textureLoad(limits, vec2i((i + 1) % n, 0), 0).x, fract(place));
}

// Lattice node before a point of the disc, and the offset from it.
fn lattice_cell(nodes: texture_2d<f32>, p: vec2f, before: ptr<function, vec2i>) -> vec2f {
  let n = i32(textureDimensions(nodes).x);
  let place = (p / u.ends.y + 1.0) / 2.0 * f32(n - 1);
  *before = vec2i(clamp(floor(place), vec2f(0.0), vec2f(f32(n - 2))));
  return place - vec2f(*before);
}

// Bilinear interpolation of the lattice.
fn bilinear(nodes: texture_2d<f32>, p: vec2f) -> vec3f {
  var i: vec2i;
  let f = lattice_cell(nodes, p, &i);
  let low = mix(textureLoad(nodes, i, 0).xyz, textureLoad(nodes, i + vec2i(1, 0), 0).xyz, f.x);
  let high = mix(textureLoad(nodes, i + vec2i(0, 1), 0).xyz, textureLoad(nodes, i + vec2i(1, 1), 0).xyz, f.x);
  return mix(low, high, f.y);
}

// Bicubic interpolation; bilinear errors reach 0.1 px near the rim.
fn bicubic(nodes: texture_2d<f32>, p: vec2f) -> vec3f {
  var i: vec2i;
  let last = vec2i(textureDimensions(nodes)) - 1;
  let f = lattice_cell(nodes, p, &i);
  let wx = weights(f.x, KEYS_A_LATTICE);
  let wy = weights(f.y, KEYS_A_LATTICE);
  var total = vec3f(0.0);
  for (var j = 0; j < 4; j++) {
    for (var k = 0; k < 4; k++) {
      total += wy[j] * wx[k] * textureLoad(nodes, clamp(i + vec2i(k - 1, j - 1), vec2i(0), last), 0).xyz;
    }
  }
  return total;
}

// Azimuth and s of a vector (axis, right, down).
fn polar(t: vec3f, azimuth: ptr<function, vec2f>) -> f32 {
  let across = length(t.yz);
  *azimuth = select(vec2f(1.0, 0.0), t.yz / across, across > 0.0);
  return half_angle(across, t.x).x;
}

// The same for a point, with the ray origin of a camera without rotational symmetry.
fn solve_without_symmetry(t: vec3f, azimuth: ptr<function, vec2f>) -> f32 {
  *azimuth = vec2f(1.0, 0.0);
  var s = 0.0;
  for (var i = 0; i < ROUGH_STEPS; i++) { s = polar(t - bilinear(starts, min(s, u.ends.y) * *azimuth), azimuth); }
  for (var i = 0; i < FINE_STEPS; i++) { s = polar(t - bicubic(starts, min(s, u.ends.y) * *azimuth), azimuth); }
  return s;
}

fn project(world: vec3f, visible: ptr<function, bool>) -> vec2f {
  let t = u.frame * world;
  var azimuth: vec2f;
  var s: f32;
  if (u.is_point != 0u && u.has_starts != 0u) { s = solve_without_symmetry(t, &azimuth); } else { s = polar(t, &azimuth); }
  if (u.is_point != 0u && u.has_origins != 0u) { s = solve(length(t.yz), t.x); }
  var offset: vec2f;
  if (u.has_lattice != 0u) {
    let end = limit_at(azimuth);
    *visible = s <= end;
    offset = bicubic(lattice, min(s, end + 2.0 * u.ends.y / f32(textureDimensions(lattice).x)) * azimuth).xy - u.own_centre;
  } else {
    *visible = s >= u.ends.x - 1e-6 && s <= u.ends.y + 1e-6;
    var value: vec3f;
    var rate: vec3f;
    cell(s, &value, &rate);
    offset = max(value.x, 0.0) * azimuth;
  }
  let pixel = u.centre + u.scale * offset;
  *visible = *visible && all(pixel >= vec2f(-0.5)) && all(pixel <= u.image_size - 0.5);
  return pixel;
}`;

const SAMPLING = `
fn texel(p: vec2i) -> vec3f {
  return textureLoad(image, clamp(p, vec2i(0), vec2i(textureDimensions(image)) - 1), 0).rgb;
}

fn cubic(at: vec2f) -> vec3f {
  var p = at;
  let stored_size = vec2f(textureDimensions(image)); // smaller for images above the texture limit
  if (any(stored_size != u.image_size)) { p = (p + 0.5) * stored_size / u.image_size - 0.5; }
  let i = vec2i(floor(p));
  let wx = weights(p.x - f32(i.x), KEYS_A);
  let wy = weights(p.y - f32(i.y), KEYS_A);
  var total = vec3f(0.0);
  for (var j = 0; j < 4; j++) {
    var row = vec3f(0.0);
    for (var k = 0; k < 4; k++) { row += wx[k] * texel(i + vec2i(k - 1, j - 1)); }
    total += wy[j] * row;
  }
  return clamp(total, vec3f(0.0), vec3f(1.0));
}

fn sharpness_scale(side: f32) -> f32 {
  return 1.0 - pow(SHARP / max(side, SHARP), 8.0);
}

fn taps(side: f32) -> i32 {
  if (side <= SHARP) { return 1; }
  return i32(clamp(ceil(side * sharpness_scale(side) / SPACING), 2.0, f32(MAX_TAPS)));
}

// Whether the field contains a point: for cameras with an axis, between two radii.
fn is_in_field(p: vec2f) -> bool {
  if (any(p < vec2f(-0.5)) || any(p > u.image_size - 0.5)) { return false; }
  if (u.has_lattice != 0u) { return true; }
  let r = length(p - u.centre) / u.scale;
  let last = i32(textureDimensions(radii).x) - 1;
  return r >= textureLoad(radii, vec2i(0), 0).x - 1e-3 && r <= textureLoad(radii, vec2i(last, 0), 0).x + 1e-3;
}

// Mean over the footprint of the pixel, a parallelogram; with fewer, bilinear samples while the view moves.
fn mean(p: vec2f, right: vec2f, down: vec2f) -> vec3f {
  let across = length(right);
  let along = length(down);
  let n = taps(across);
  let m = taps(along);
  if (n * m == 1) { return cubic(p); }
  let side = right * sharpness_scale(across);
  let height = down * sharpness_scale(along);
  var total = vec3f(0.0);
  var count = 0.0;
  for (var j = 0; j < m; j++) {
    for (var k = 0; k < n; k++) {
      let at = p + ((f32(k) + 0.5) / f32(n) - 0.5) * side + ((f32(j) + 0.5) / f32(m) - 0.5) * height;
      if (!is_in_field(at)) { continue; }
      if (u.is_preview != 0u) { total += textureSampleLevel(image, linear, (at + 0.5) / u.image_size, 0.0).rgb; }
      else { total += cubic(at); }
      count += 1.0;
    }
  }
  if (count == 0.0) { return cubic(p); }
  return total / count;
}`;

const declarations = [
  `struct Uniforms { ${Object.entries(UNIFORMS)
    .map(([name, type]) => `${name}: ${TYPES[type]}`)
    .join(", ")} }`,
  ...Object.entries(CONSTANTS.integers).map(([name, value]) => `const ${name}: i32 = ${value};`),
  ...Object.entries(CONSTANTS.numbers).map(([name, value]) => `const ${name}: f32 = ${value};`),
].join("\n");

export const SHADER = `
${declarations}
@group(0) @binding(0) var<uniform> u: Uniforms;
@group(0) @binding(1) var linear: sampler;
@group(0) @binding(2) var image: texture_2d<f32>;
@group(0) @binding(3) var radii: texture_2d<f32>;
@group(0) @binding(4) var lattice: texture_2d<f32>;
@group(0) @binding(5) var limits: texture_2d<f32>;
@group(0) @binding(6) var starts: texture_2d<f32>;
${VERTEX}
${COS_SIN}
${TARGET}
${KERNEL}
${PROJECTION}
${SAMPLING}

@fragment fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
  let from_corner = position.xy - u.corner;
  let p = vec2f(from_corner.x - 0.5, u.size.y - from_corner.y - 0.5);
  var inside: bool;
  var visible: bool;
  let at = project(world_vector(p, &inside), &visible);
  let right = dpdx(at);
  let down = -dpdy(at);
  visible = visible && inside;
  if (u.wants_coordinates != 0u) { return vec4f(at, select(0.0, 1.0, visible), 1.0); }
  if (!visible) { return vec4f(0.0); }
  return vec4f(mean(at, right, down), 1.0);
}`;

/** Shader that reverses the rows of a view. */
export const REVERSAL = `
@group(0) @binding(0) var rows: texture_2d<f32>;
${VERTEX}

@fragment fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
  let p = vec2i(position.xy);
  return textureLoad(rows, vec2i(p.x, i32(textureDimensions(rows).y) - 1 - p.y), 0);
}`;
