// SPDX-License-Identifier: GPL-3.0-or-later
// The deviation on the part, in three dimensions: turn, move, come nearer, cut, ask for a value.
// `data`: rows, cols, x0, y0, dx, dy (mm), z and d (mm, as 16 bit whole steps), zScale, dScale,
// limit. WebGL 1 alone; nothing is loaded.
function deviationView(canvas, data) {
  const gl = canvas.getContext('webgl', { antialias: true, preserveDrawingBuffer: true });
  const label = canvas.parentNode.querySelector('.value');
  if (!gl) { label.textContent = 'This browser shows no WebGL.'; return; }
  gl.getExtension('OES_element_index_uint');
  const words = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Int16Array(bytes.buffer);
  };
  const VOID = -32768, z = words(data.z), d = words(data.d), rows = data.rows, cols = data.cols;
  const height = (i) => z[i] * data.zScale, deviation = (i) => (d[i] === VOID ? NaN : d[i] * data.dScale);
  const wide = (cols - 1) * data.dx, deep = (rows - 1) * data.dy, size = Math.max(wide, deep);
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < z.length; ++i) if (z[i] !== VOID) { low = Math.min(low, height(i)); high = Math.max(high, height(i)); }
  const middle = (low + high) / 2;
  const position = new Float32Array(3 * z.length), normal = new Float32Array(3 * z.length), value = new Float32Array(z.length);
  const at = (r, c) => { const i = Math.min(rows - 1, Math.max(0, r)) * cols + Math.min(cols - 1, Math.max(0, c)); return z[i] === VOID ? middle : height(i); };
  for (let r = 0; r < rows; ++r) for (let c = 0; c < cols; ++c) {
    const i = r * cols + c;
    position.set([(c * data.dx - wide / 2) / size, (r * data.dy - deep / 2) / size, (at(r, c) - middle) / size], 3 * i);
    const nx = -(at(r, c + 1) - at(r, c - 1)) / (2 * data.dx), ny = -(at(r + 1, c) - at(r - 1, c)) / (2 * data.dy);
    normal.set([nx, ny, 1], 3 * i);
    value[i] = d[i] === VOID ? 1e9 : deviation(i) / data.limit;
  }
  const index = [];
  for (let r = 0; r + 1 < rows; ++r) for (let c = 0; c + 1 < cols; ++c) {
    const a = r * cols + c, b = a + 1, e = a + cols, f = e + 1;
    if (z[a] === VOID || z[f] === VOID) continue;
    if (z[b] !== VOID) index.push(a, b, f);
    if (z[e] !== VOID) index.push(a, f, e);
  }
  const shader = (kind, text) => { const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s); return s; };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `
    attribute vec3 p, n; attribute float v; uniform mat4 view; uniform float exaggeration, bend;
    varying float value; varying vec3 normal, place;
    void main() { value = v; normal = vec3(n.xy * exaggeration, 1.0); place = p;
      float lift = abs(v) < 1e8 ? v * bend : 0.0;
      gl_Position = view * vec4(p.xy, p.z * exaggeration + lift, 1.0); }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `
    precision mediump float; varying float value; varying vec3 normal, place; uniform vec2 cut;
    void main() { if (place.x > cut.x || place.y > cut.y) discard;
      vec3 colour = vec3(0.6);
      if (abs(value) < 1e6) { float t = clamp(value, -1.0, 1.0);
        colour = t < 0.0 ? mix(vec3(0.97), vec3(0.13, 0.40, 0.67), -t) : mix(vec3(0.97), vec3(0.70, 0.09, 0.17), t); }
      float light = 0.5 + 0.55 * max(0.0, dot(normalize(normal), normalize(vec3(-0.5, 0.5, 0.7))));
      gl_FragColor = vec4(colour * light, 1.0); }`));
  gl.linkProgram(program);
  gl.useProgram(program);
  const buffer = (name, array, n) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    const slot = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(slot);
    gl.vertexAttribPointer(slot, n, gl.FLOAT, false, 0, 0);
  };
  buffer('p', position, 3); buffer('n', normal, 3); buffer('v', value, 1);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(index), gl.STATIC_DRAW);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const state = { turn: -0.6, tilt: 0.9, distance: 1.3, x: 0, y: 0, exaggeration: 1, bend: 0, cutX: 1, cutY: 1 };
  const product = (a, b) => { const m = new Float32Array(16); for (let c = 0; c < 4; ++c) for (let r = 0; r < 4; ++r) for (let k = 0; k < 4; ++k) m[4 * c + r] += a[4 * k + r] * b[4 * c + k]; return m; };
  let view = new Float32Array(16);
  function draw() {
    const w = canvas.clientWidth * (window.devicePixelRatio || 1), h = canvas.clientHeight * (window.devicePixelRatio || 1);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, canvas.width, canvas.height);
    const cs = Math.cos(state.turn), sn = Math.sin(state.turn), ct = Math.cos(state.tilt), st = Math.sin(state.tilt);
    const turn = [cs, sn, 0, 0, -sn, cs, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    const tilt = [1, 0, 0, 0, 0, ct, -st, 0, 0, st, ct, 0, 0, 0, 0, 1];
    const move = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, state.x, state.y, -state.distance, 1];
    const f = 1.6, near = 0.01, far = 20;
    const lens = [f * canvas.height / canvas.width, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    // Tilt 0 looks straight down.
    view = product(lens, product(move, product(tilt, turn)));
    gl.clearColor(0, 0, 0, 0); gl.enable(gl.DEPTH_TEST); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(uniform('view'), false, view);
    gl.uniform1f(uniform('exaggeration'), state.exaggeration); gl.uniform1f(uniform('bend'), state.bend);
    gl.uniform2f(uniform('cut'), (state.cutX - 0.5) * wide / size + 1e-4, (state.cutY - 0.5) * deep / size + 1e-4);
    gl.drawElements(gl.TRIANGLES, index.length, gl.UNSIGNED_INT, 0);
    canvas.dataset.triangles = index.length / 3;
  }
  let held = null;
  canvas.addEventListener('pointerdown', (e) => { held = { x: e.clientX, y: e.clientY, moved: false, shift: e.shiftKey || e.button === 2 }; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener('contextmenu', (e) => e.preventDefault());
  canvas.addEventListener('pointermove', (e) => {
    if (!held) return;
    const dx = e.clientX - held.x, dy = e.clientY - held.y;
    if (Math.abs(dx) + Math.abs(dy) > 3) held.moved = true;
    if (!held.moved) return;
    if (held.shift) { state.x += dx * state.distance / 800; state.y -= dy * state.distance / 800; }
    else { state.turn += dx / 200; state.tilt = Math.min(1.55, Math.max(0, state.tilt - dy / 200)); }
    held.x = e.clientX; held.y = e.clientY; draw();
  });
  canvas.addEventListener('pointerup', (e) => { if (held && !held.moved) ask(e); held = null; });
  canvas.addEventListener('wheel', (e) => { e.preventDefault(); state.distance = Math.min(5, Math.max(0.03, state.distance * Math.exp(e.deltaY / 600))); draw(); }, { passive: false });
  // The vertex nearest to the click on the screen; of those within 6 px the nearest to the eye.
  function ask(e) {
    const box = canvas.getBoundingClientRect(), px = 2 * (e.clientX - box.left) / box.width - 1, py = 1 - 2 * (e.clientY - box.top) / box.height;
    let best = -1, score = Infinity;
    for (let i = 0; i < z.length; ++i) {
      if (z[i] === VOID) continue;
      const x = position[3 * i], y = position[3 * i + 1], h = position[3 * i + 2] * state.exaggeration;
      const w = view[3] * x + view[7] * y + view[11] * h + view[15];
      const sx = (view[0] * x + view[4] * y + view[8] * h + view[12]) / w - px, sy = (view[1] * x + view[5] * y + view[9] * h + view[13]) / w - py;
      const off = Math.hypot(sx * box.width / 2, sy * box.height / 2);
      if (off < 6 && w + off / 1000 < score) { score = w + off / 1000; best = i; }
    }
    if (best < 0) { label.textContent = 'nothing there'; return; }
    const c = best % cols, r = (best - c) / cols, v = deviation(best);
    label.textContent = `x ${(data.x0 + c * data.dx).toFixed(1)}, y ${(data.y0 + r * data.dy).toFixed(1)}, z ${height(best).toFixed(2)} mm: ` + (isNaN(v) ? 'not measured' : `${v >= 0 ? '+' : ''}${v.toFixed(3)} mm`);
  }
  for (const input of canvas.parentNode.querySelectorAll('input')) {
    const set = () => { state[input.name] = +input.value; draw(); };
    input.addEventListener('input', set); set();
  }
  window.addEventListener('resize', draw);
  draw();
}
