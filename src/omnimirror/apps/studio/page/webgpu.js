function e(e){e?.catch(e=>reportError(e))}var t=class{canvas;camera=null;isPreview=!1;picture=null;restored=null;additional=new Map;constructor(e){this.canvas=e}setCamera(e){this.camera=e}setImage(e,t,n){let r=this.upload(e,this.picture?.texture??null);this.picture={texture:r,width:t,height:n}}setRestored(e){e?this.restored=this.upload(e,this.restored):this.restored!==null&&this.remove(this.restored),e||(this.restored=null)}draw(e,t=!1,n=null){let{canvas:r,picture:i}=this;if((r.width!==e.width||r.height!==e.height)&&(r.width=e.width,r.height=e.height),this.isPreview=t,this.clear(),!i||(this.drawParts(e,i),n===null||this.restored===null))return;let a=Math.round(n*e.width);this.drawParts(e,{...i,texture:this.restored},a)}drawSheet(e,t,n){let{camera:r,picture:i}=this;this.draw({width:t,height:n,parts:[]},!0);for(let{camera:r,parts:a}of e)this.setCamera(r),i&&this.drawParts({width:t,height:n,parts:a},i);r&&this.setCamera(r)}add(e,{camera:t,feed:{image:n,width:r,height:i}},a){let o=this.camera,s=this.additional.get(a),c=s?.source!==n||n instanceof HTMLVideoElement?this.upload(n,s?.texture??null):s.texture;this.additional.set(a,{source:n,texture:c}),this.setCamera(t),this.drawParts(e,{texture:c,width:r,height:i}),o&&this.setCamera(o)}retainImages(e){for(let[t,{texture:n}]of this.additional)e.includes(t)||(this.remove(n),this.additional.delete(t))}async coordinates(e){return this.picture?this.readCoordinates(e,this.picture):new Float32Array}forget(){this.camera=this.picture=this.restored=null,this.additional.clear()}},n={frame:`mat3`,axes:`mat3`,numbers:`vec4`,image_size:`vec2`,size:`vec2`,corner:`vec2`,ends:`vec2`,centre:`vec2`,own_centre:`vec2`,scale:`float`,eye:`float`,distance_mm:`float`,shape:`int`,is_point:`bool`,has_origins:`bool`,has_starts:`bool`,has_lattice:`bool`,wants_coordinates:`bool`,is_preview:`bool`};function r(e,t){let{axis:n,right:r,down:i,tables:a,centre_px:o}=e.model,s=[n,r,i];return{frame:[0,1,2].flatMap(e=>s.map(t=>t[e])),image_size:t,ends:[a.first,a.last],centre:[e.circle.u,e.circle.v],own_centre:o,scale:e.scale,eye:a.viewpoint_mm,has_origins:a.origins>0,has_starts:a.starts>0,has_lattice:a.lattice>0}}var i=(e,t)=>({size:[e.width,e.height],corner:[e.left,t],axes:e.axes.flat(),numbers:e.numbers,distance_mm:e.distance,shape:e.shape,is_point:e.isPoint}),a=[`radii`,`lattice`,`limits`,`starts`];function o({model:e,tables:t}){let{lattice:n,limits:r,starts:i,radii:a,origins:o}=e.tables,s=(e,n)=>t.subarray(e,e+n);if(!n){let e=new Float32Array(4*a);for(let n=0;n<a;n++)for(let r=0;r<(o?3:1);r++)e[4*n+r]=t[r*a+n];return[{name:`radii`,width:a,height:1,components:4,values:e}]}let c=2*n*n,l=[{name:`lattice`,width:n,height:n,components:2,values:s(0,c)},{name:`limits`,width:r,height:1,components:1,values:s(c,r)}];if(!i)return l;let u=new Float32Array(4*i*i);for(let e=0;e<i*i;e++)for(let n=0;n<3;n++)u[4*e+n]=t[c+r+3*e+n];return[...l,{name:`starts`,width:i,height:i,components:4,values:u}]}var s={integers:{ROUGH_STEPS:8,FINE_STEPS:4,MAX_TAPS:16},numbers:{KEYS_A:`-0.75`,KEYS_A_LATTICE:`-0.5`,SHARP:`1.2`,SPACING:`1.5`}},c=`floor(x * 0.6366197723675814 + 0.5)`,l=`(x - k * 1.5707963705062866) + k * 4.371139e-8`,u=`r + r * q * (-0.16666666 + q * (0.008333331 + q * (-0.00019840874 + q * 2.7525562e-6)))`,d=`1.0 + q * (-0.5 + q * (0.04166666 + q * (-0.0013888397 + q * 2.4760495e-5)))`,f=`
    ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a,
    ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0,
    ((a + 2.0) * y - (a + 3.0)) * y * y + 1.0,
    ((a * z - 5.0 * a) * z + 8.0 * a) * z - 4.0 * a
  `,p={mat3:`mat3x3f`,vec4:`vec4f`,vec2:`vec2f`,float:`f32`,int:`i32`,bool:`u32`},m=`
@vertex fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  let corner = vec2f(select(-1.0, 3.0, index == 1u), select(-1.0, 3.0, index == 2u));
  return vec4f(corner, 0.0, 1.0);
}`,h=`
fn cos_sin(x: f32) -> vec2f {
  let k = ${c};
  let r = ${l};
  let q = r * r;
  let s = ${u};
  let c = ${d};
  let turn = i32(k) & 3;
  let swapped = select(vec2f(c, s), vec2f(-s, c), (turn & 1) == 1);
  return select(-swapped, swapped, turn < 2);
}`,g=`
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
}`,_=`
// Bicubic kernel of Keys.
fn weights(t: f32, a: f32) -> vec4f {
  let x = 1.0 + t;
  let y = 1.0 - t;
  let z = 2.0 - t;
  return vec4f(${f});
}`,v=`
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
}`,y=`
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
}`,b=`
${[`struct Uniforms { ${Object.entries(n).map(([e,t])=>`${e}: ${p[t]}`).join(`, `)} }`,...Object.entries(s.integers).map(([e,t])=>`const ${e}: i32 = ${t};`),...Object.entries(s.numbers).map(([e,t])=>`const ${e}: f32 = ${t};`)].join(`
`)}
@group(0) @binding(0) var<uniform> u: Uniforms;
@group(0) @binding(1) var linear: sampler;
@group(0) @binding(2) var image: texture_2d<f32>;
@group(0) @binding(3) var radii: texture_2d<f32>;
@group(0) @binding(4) var lattice: texture_2d<f32>;
@group(0) @binding(5) var limits: texture_2d<f32>;
@group(0) @binding(6) var starts: texture_2d<f32>;
${m}
${h}
${g}
${_}
${v}
${y}

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
}`,x=`
@group(0) @binding(0) var rows: texture_2d<f32>;
${m}

@fragment fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
  let p = vec2i(position.xy);
  return textureLoad(rows, vec2i(p.x, i32(textureDimensions(rows).y) - 1 - p.y), 0);
}`,S={mat3:48,vec4:16,vec2:8,float:4,int:4,bool:4},C=`rgba8unorm`,w=`rgba32float`,T={1:`r32float`,2:`rg32float`,4:w},E=256,D={},O=0;for(let[e,t]of Object.entries(n))D[e]=O,O+=S[t];var k=16*Math.ceil(O/16);async function A(t,n,r){let{maxTextureDimension2D:i}=t.limits,a=await t.requestDevice({requiredLimits:{maxTextureDimension2D:i}});e(a.lost.then(r)),a.addEventListener(`uncapturederror`,r);let o=new j(n,a);if(await o.prepare(),!o.isReadable())throw Error(`Images of the view cannot be copied.`);return o}var j=class extends t{device;name=`WebGPU`;context;format=navigator.gpu.getPreferredCanvasFormat();module;layout;sampler;noTable;stride;uniforms=null;pipeline;reversal;rows=null;tables=new WeakMap;frames=new WeakMap;isCleared=!1;constructor(e,t){super(e),this.device=t;let n=e.getContext(`webgpu`);if(!n)throw Error(`The canvas does not support WebGPU.`);n.configure({device:t,format:this.format,alphaMode:`premultiplied`}),this.context=n,this.module=t.createShaderModule({code:b});let r=t.limits.minUniformBufferOffsetAlignment;this.stride=r*Math.ceil(k/r);let i=GPUShaderStage.FRAGMENT,o={sampleType:`unfilterable-float`};this.layout=t.createBindGroupLayout({entries:[{binding:0,visibility:i,buffer:{hasDynamicOffset:!0,minBindingSize:k}},{binding:1,visibility:i,sampler:{}},{binding:2,visibility:i,texture:{}},...a.map((e,t)=>({binding:3+t,visibility:i,texture:o}))]}),this.sampler=t.createSampler({magFilter:`linear`,minFilter:`linear`}),this.noTable=t.createTexture({size:[1,1],format:T[1],usage:GPUTextureUsage.TEXTURE_BINDING})}async prepare(){let{device:e,format:t}=this,n=e.createShaderModule({code:x});[this.pipeline,this.reversal]=await Promise.all([this.pipelineFor(C),e.createRenderPipelineAsync({layout:`auto`,vertex:{module:n},fragment:{module:n,targets:[{format:t}]}})])}isReadable(){let e=this.device.createCommandEncoder();e.beginRenderPass(M(this.context.getCurrentTexture(),`clear`,[0,1,0,1])).end(),this.device.queue.submit([e.finish()]);let t=new OffscreenCanvas(1,1).getContext(`2d`);return t.drawImage(this.canvas,0,0),t.getImageData(0,0,1,1).data[1]===255}get maxImageSide(){return this.device.limits.maxTextureDimension2D}release(){this.device.destroy()}upload(e,t){let n=e instanceof HTMLVideoElement?this.frame(e):e,{width:r,height:i}=n,a=t;(a?.width!==r||a.height!==i)&&(a?.destroy(),a=this.device.createTexture({size:[r,i],format:C,usage:GPUTextureUsage.TEXTURE_BINDING|GPUTextureUsage.COPY_DST|GPUTextureUsage.RENDER_ATTACHMENT}));let o={texture:a};return this.device.queue.copyExternalImageToTexture({source:n},o,[r,i]),a}frame(e){let{videoWidth:t,videoHeight:n}=e,r=this.frames.get(e);return(r?.canvas.width!==t||r.canvas.height!==n)&&(r=new OffscreenCanvas(t,n).getContext(`2d`),this.frames.set(e,r)),r.drawImage(e,0,0),r.canvas}remove(e){e.destroy()}clear(){this.isCleared=!0}drawParts(e,t,n=0){if(!this.camera)return;let{device:r}=this,{width:i,height:a}=this.canvas;(this.rows?.width!==i||this.rows.height!==a)&&(this.rows?.destroy(),this.rows=r.createTexture({size:[i,a],format:C,usage:GPUTextureUsage.RENDER_ATTACHMENT|GPUTextureUsage.TEXTURE_BINDING}));let o=r.createCommandEncoder(),s=this.isCleared?`clear`:`load`;this.isCleared=!1,this.encode(o,this.pipeline,{view:e,picture:t,from:n,target:this.rows,loadOp:s});let c=o.beginRenderPass(M(this.context.getCurrentTexture())),l=[{binding:0,resource:this.rows.createView()}],u=this.reversal.getBindGroupLayout(0);c.setPipeline(this.reversal),c.setBindGroup(0,r.createBindGroup({layout:u,entries:l})),c.draw(3),c.end(),r.queue.submit([o.finish()])}async readCoordinates(e,t){let{device:n}=this,{width:r,height:i}=e,a=await this.pipelineFor(w),o=n.createTexture({size:[r,i],format:w,usage:GPUTextureUsage.RENDER_ATTACHMENT|GPUTextureUsage.COPY_SRC}),s=E*Math.ceil(16*r/E),c=n.createBuffer({size:s*i,usage:GPUBufferUsage.COPY_DST|GPUBufferUsage.MAP_READ}),l=n.createCommandEncoder(),u={view:e,picture:t,from:0,target:o,loadOp:`clear`,wantsCoordinates:!0};this.encode(l,a,u),l.copyTextureToBuffer({texture:o},{buffer:c,bytesPerRow:s},[r,i]),n.queue.submit([l.finish()]),await c.mapAsync(GPUMapMode.READ);let d=new Float32Array(c.getMappedRange()),f=new Float32Array(4*r*i);for(let e=0;e<i;e++){let t=(i-1-e)*s/4;f.set(d.subarray(t,t+4*r),4*r*e)}return c.destroy(),o.destroy(),f}encode(e,t,{view:n,picture:a,from:o,target:s,loadOp:c,wantsCoordinates:l=!1}){let u=this.camera,d=n.parts.map(e=>{let t=n.height-e.top-e.height,[r,a]=[Math.max(e.left,o),Math.max(t,0)],c=Math.min(e.left+e.width,s.width)-r,l=Math.min(t+e.height,s.height)-a;return{rectangle:[r,a,Math.max(c,0),Math.max(l,0)],values:i(e,t)}}),f={...r(u,[a.width,a.height]),wants_coordinates:l,is_preview:this.isPreview},p=this.buffer(d.map(({values:e})=>({...f,...e}))),m=this.bindings(u,a.texture,p),h=e.beginRenderPass(M(s,c));h.setPipeline(t),d.forEach(({rectangle:e},t)=>{e[2]&&e[3]&&(h.setBindGroup(0,m,[t*this.stride]),h.setScissorRect(...e),h.draw(3))}),h.end()}buffer(e){let t=new ArrayBuffer(this.stride*Math.max(1,e.length));return e.forEach((e,n)=>N(e,new DataView(t,n*this.stride))),(!this.uniforms||this.uniforms.size<t.byteLength)&&(this.uniforms?.destroy(),this.uniforms=this.device.createBuffer({size:t.byteLength,usage:GPUBufferUsage.UNIFORM|GPUBufferUsage.COPY_DST})),this.device.queue.writeBuffer(this.uniforms,0,t),this.uniforms}bindings(e,t,n){let r=this.stored(e);return this.device.createBindGroup({layout:this.layout,entries:[{binding:0,resource:{buffer:n,size:k}},{binding:1,resource:this.sampler},{binding:2,resource:t.createView()},...a.map((e,t)=>({binding:3+t,resource:(r[e]??this.noTable).createView()}))]})}stored(e){let t=this.tables.get(e.tables);if(t)return t;t={};for(let{name:n,width:r,height:i,components:a,values:s}of o(e)){let e=t[n]=this.device.createTexture({size:[r,i],format:T[a],usage:GPUTextureUsage.TEXTURE_BINDING|GPUTextureUsage.COPY_DST});this.device.queue.writeTexture({texture:e},s,{bytesPerRow:4*a*r},[r,i])}return this.tables.set(e.tables,t),t}pipelineFor(e){let{device:t,module:n,layout:r}=this;return t.createRenderPipelineAsync({layout:t.createPipelineLayout({bindGroupLayouts:[r]}),vertex:{module:n},fragment:{module:n,targets:[{format:e}]}})}},M=(e,t=`clear`,n=[0,0,0,0])=>({colorAttachments:[{view:e.createView(),loadOp:t,clearValue:n,storeOp:`store`}]});function N(e,t){for(let[r,i]of Object.entries(e)){let e=n[r],a=D[r];e===`int`||e===`bool`?t.setInt32(a,+i,!0):(Array.isArray(i)?i:[i]).forEach((n,r)=>{let i=e===`mat3`?4*Math.floor(r/3)+r%3:r;t.setFloat32(a+4*i,n,!0)})}}export{A as begin};