// SPDX-License-Identifier: GPL-3.0-or-later
// Programs in three dimensions; see path_view.hpp for the scene. Each <div class="pathview"> holds
// its scene in a <script type="application/json"> and gets controls, a canvas and a scale.
'use strict';
(() => {
  // As backplot_colour() in cnc/backplot.cpp.
  const COLOURS = [[48, 18, 117], [40, 110, 200], [30, 160, 135], [120, 190, 60], [235, 185, 40],
    [190, 35, 20]];
  const RAPID = [0.75, 0.0, 0.59];
  const CUT = 1, RAPID_KIND = 2;  // 0: first of a run

  const VERTEX = `#version 300 es
    precision highp float;
    in vec3 from, to; in float kind, value;
    uniform mat4 view; uniform vec3 low, size; uniform vec2 half_px, scale;
    uniform float width, drawn_kind; uniform int mode; uniform vec3 colours[6], rapid;
    out vec3 colour;
    void main() {
      vec4 a = view * vec4(low + from * size, 1.0), b = view * vec4(low + to * size, 1.0);
      vec2 d = (b.xy - a.xy) * half_px;
      float l = length(d);
      d = l > 1e-6 ? d / l : vec2(1.0, 0.0);
      bool end = gl_VertexID > 1;
      float side = gl_VertexID % 2 == 0 ? -1.0 : 1.0;
      vec4 p = end ? b : a;
      p.xy += 0.5 * width * (side * vec2(-d.y, d.x) + (end ? d : -d)) / half_px;
      p.z -= 0.0002;
      gl_Position = kind == drawn_kind ? p : vec4(2.0, 2.0, 2.0, 1.0);
      float v = mode == 0 ? (low + to * size).z : value;
      float share = clamp((v - scale.x) / (scale.y - scale.x), 0.0, 1.0) * 5.0;
      int i = min(int(share), 4);
      colour = drawn_kind == 2.0 ? rapid : mix(colours[i], colours[i + 1], share - float(i));
    }`;
  const FRAGMENT = `#version 300 es
    precision mediump float;
    in vec3 colour; out vec4 shown;
    void main() { shown = vec4(colour, 1.0); }`;
  const GROUND_VERTEX = `#version 300 es
    precision highp float;
    in float z; in vec2 slope;
    uniform mat4 view; uniform vec2 origin, step_mm; uniform int cols; uniform float exaggeration;
    uniform vec3 tint;
    out vec3 colour;
    void main() {
      vec2 at = origin + step_mm * vec2(gl_VertexID % cols, gl_VertexID / cols);
      gl_Position = view * vec4(at, z, 1.0);
      vec3 normal = normalize(vec3(-slope * exaggeration, 1.0));
      colour = tint * (0.35 + 0.65 * max(0.0, dot(normal, normalize(vec3(-1.0, 1.0, 1.2)))));
    }`;

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const build = (gl, vertex, fragment) => {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
        throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new Error(gl.getProgramInfoLog(program));
    const at = (name) => gl.getUniformLocation(program, name);
    return {program, at, attribute: (name) => gl.getAttribLocation(program, name)};
  };
  const filled = (gl, target, data) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, data, gl.STATIC_DRAW);
    return buffer;
  };
  const niceTicks = (low, high, most) => {
    if (!(high > low)) return [low];
    let step = 10 ** Math.floor(Math.log10((high - low) / most));
    for (const f of [1, 2, 5, 10])
      if ((high - low) / (f * step) <= most) { step *= f; break; }
    const ticks = [];
    for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; ++k)
      ticks.push(k * step);
    return ticks;
  };
  const element = (name, attributes = {}, ...children) => {
    const e = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    e.append(...children);
    return e;
  };
  const short = (v) => String(Number(v.toPrecision(4)));

  class View {
    constructor(root) {
      this.scene = JSON.parse(root.querySelector('script').textContent);
      this.controls = element('div', {class: 'controls'});
      this.canvas = element('canvas', {tabindex: '0', 'aria-label': 'toolpath in three dimensions'});
      this.legend = element('div', {class: 'scale'});
      this.note = element('p', {class: 'note'});
      root.append(this.controls, this.canvas, this.legend, this.note);
      this.gl = this.canvas.getContext('webgl2', {antialias: true});
      if (!this.gl) {
        this.canvas.replaceWith(element('p', {class: 'warn'},
          'This browser has no WebGL 2; the pictures of each program show the same from above.'));
        return;
      }
      this.colours = new Float32Array(COLOURS.flat().map((c) => c / 255));
      this.load();
      this.addControls();
      this.addHands();
      this.reset('oblique');
      new ResizeObserver(() => this.later()).observe(this.canvas);
    }

    load() {
      const gl = this.gl, s = this.scene;
      this.lines = build(gl, VERTEX, FRAGMENT);
      this.low = s.low_mm;
      this.size = s.size_mm;
      // What is looked at: cuts and ground; rapids may go far above.
      const least = [Infinity, Infinity, Infinity], most = [-Infinity, -Infinity, -Infinity];
      const see = (v, i) => { least[i] = Math.min(least[i], v); most[i] = Math.max(most[i], v); };
      for (const p of s.programs) {
        p.places = new Uint16Array(bytes(p.places));
        p.kinds = new Uint8Array(bytes(p.kinds));
        p.values = {feed: new Uint16Array(bytes(p.feed))};
        if (p.engagement !== null) p.values.engagement = new Uint16Array(bytes(p.engagement));
        p.count = p.kinds.length;
        p.shown = true;
        for (let i = 0; i < p.count; ++i)
          for (let k = 0; p.kinds[i] !== RAPID_KIND && k < 3; ++k)
            see(this.low[k] + p.places[3 * i + k] / 65535 * this.size[k], k);
        p.place_buffer = filled(gl, gl.ARRAY_BUFFER, p.places);
        p.kind_buffer = filled(gl, gl.ARRAY_BUFFER, p.kinds);
        p.value_buffers = {};
        for (const [key, data] of Object.entries(p.values))
          p.value_buffers[key] = filled(gl, gl.ARRAY_BUFFER, data);
      }
      const g = s.ground;
      if (g) {
        [0, 1].forEach((k) => {
          see(g.origin_mm[k], k);
          see(g.origin_mm[k] + g.step_mm[k] * ((k ? g.rows : g.cols) - 1), k);
        });
        see(g.low_mm, 2);
        see(g.low_mm + g.range_mm, 2);
        this.ground = build(gl, GROUND_VERTEX, FRAGMENT);
        const share = new Uint16Array(bytes(g.heights)), z = new Float32Array(share.length);
        for (let i = 0; i < z.length; ++i) z[i] = g.low_mm + share[i] / 65535 * g.range_mm;
        const slope = new Float32Array(2 * z.length), at = (r, c) => z[r * g.cols + c];
        for (let r = 0; r < g.rows; ++r)
          for (let c = 0; c < g.cols; ++c) {
            const w = Math.max(0, c - 1), e = Math.min(g.cols - 1, c + 1);
            const so = Math.max(0, r - 1), n = Math.min(g.rows - 1, r + 1);
            slope[2 * (r * g.cols + c)] = (at(r, e) - at(r, w)) / ((e - w) * g.step_mm[0]);
            slope[2 * (r * g.cols + c) + 1] = (at(n, c) - at(so, c)) / ((n - so) * g.step_mm[1]);
          }
        const index = new Uint32Array(6 * (g.rows - 1) * (g.cols - 1));
        let k = 0;
        for (let r = 0; r + 1 < g.rows; ++r)
          for (let c = 0; c + 1 < g.cols; ++c) {
            const a = r * g.cols + c, b = a + g.cols;
            index.set([a, a + 1, b + 1, a, b + 1, b], k);
            k += 6;
          }
        this.ground_z = filled(gl, gl.ARRAY_BUFFER, z);
        this.ground_slope = filled(gl, gl.ARRAY_BUFFER, slope);
        this.ground_index = filled(gl, gl.ELEMENT_ARRAY_BUFFER, index);
        this.ground_count = index.length;
      }
      this.centre = least.map((v, i) => most[i] >= v ? 0.5 * (v + most[i]) : this.low[i]);
      this.extent = least.map((v, i) => Math.max(0, most[i] - v));
      gl.enable(gl.DEPTH_TEST);
    }

    addControls() {
      const s = this.scene;
      const has = (key) => s.programs.some((p) => p.values[key]);
      const choice = element('select', {'aria-label': 'colour'});
      for (const [key, text] of [['height', 'height'], ['feed', 'feed'], ['engagement', 'engagement']])
        if (key === 'height' || has(key)) choice.append(element('option', {value: key}, text));
      this.mode = has('engagement') ? 'engagement' : 'height';
      choice.value = this.mode;
      choice.addEventListener('change', () => { this.mode = choice.value; this.rescale(); });
      const row = (...parts) => this.controls.append(element('div', {}, ...parts));
      const check = (text, on, act) => {
        const box = element('input', {type: 'checkbox'});
        box.checked = on;
        box.addEventListener('change', () => act(box.checked));
        return element('label', {}, box, ' ', text);
      };
      const button = (text, way) => {
        const b = element('button', {type: 'button'}, text);
        b.addEventListener('click', () => this.reset(way));
        return b;
      };
      this.rapids = false;
      this.show_ground = Boolean(s.ground);
      this.exaggeration = 1;
      const heights = element('select', {'aria-label': 'heights'});
      for (const f of [1, 2, 5, 10]) heights.append(element('option', {value: f}, `${f} ×`));
      heights.addEventListener('change', () => {
        this.exaggeration = Number(heights.value);
        this.later();
      });
      const progress = element('input',
        {type: 'range', min: 0, max: 1000, value: 1000, 'aria-label': 'progress'});
      this.progress = 1;
      progress.addEventListener('input', () => {
        this.progress = progress.value / 1000;
        this.later();
      });
      const ground = s.ground
        ? [check('ground', true, (on) => { this.show_ground = on; this.later(); })] : [];
      row(element('label', {}, 'colour ', choice), element('label', {}, 'heights ', heights),
        check('rapids', false, (on) => { this.rapids = on; this.later(); }), ...ground,
        button('oblique', 'oblique'), button('from above', 'above'), button('front', 'front'));
      const boxes = s.programs.map((p) => check(p.name, true, (on) => {
        p.shown = on;
        this.rescale();
      }));
      const operations = [...new Set(s.programs.map((p) => p.operation))];
      const which = element('select', {'aria-label': 'operation'});
      which.append(element('option', {value: ''}, 'all'),
        ...operations.map((name) => element('option', {value: name}, name)));
      which.addEventListener('change', () => {
        s.programs.forEach((p, i) => {
          p.shown = which.value === '' || p.operation === which.value;
          boxes[i].querySelector('input').checked = p.shown;
        });
        this.rescale();
      });
      const choices = operations.length > 1 ? [element('label', {}, 'operation ', which)] : [];
      row(...choices, ...boxes, element('label', {class: 'progress'}, 'progress ', progress));
    }

    // One finger or button turns; two fingers, or shift, or another button, move; wheel and pinch
    // zoom; arrow keys, + and - do the same.
    addHands() {
      const c = this.canvas, fingers = new Map();
      const ratio = () => c.width / c.clientWidth;
      const place = (e) => {
        const box = c.getBoundingClientRect();
        return [e.clientX - box.left, e.clientY - box.top];
      };
      c.addEventListener('contextmenu', (e) => e.preventDefault());
      c.addEventListener('pointerdown', (e) => {
        c.setPointerCapture(e.pointerId);
        fingers.set(e.pointerId, place(e));
      });
      for (const kind of ['pointerup', 'pointercancel'])
        c.addEventListener(kind, (e) => fingers.delete(e.pointerId));
      c.addEventListener('pointermove', (e) => {
        const before = fingers.get(e.pointerId);
        if (!before) return;
        const now = place(e), dx = now[0] - before[0], dy = now[1] - before[1];
        if (fingers.size === 1 && !e.shiftKey && e.buttons === 1) {
          this.yaw -= 0.008 * dx;
          this.pitch = Math.min(Math.PI / 2, Math.max(0, this.pitch + 0.008 * dy));
        } else if (fingers.size === 1) {
          this.move(dx * ratio(), dy * ratio());
        } else {
          const [id] = [...fingers.keys()].filter((k) => k !== e.pointerId);
          const other = fingers.get(id);
          const length = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
          this.move(0.5 * dx * ratio(), 0.5 * dy * ratio());
          this.zoom_at(length(now) / Math.max(1, length(before)),
            0.5 * (now[0] + other[0]), 0.5 * (now[1] + other[1]));
        }
        fingers.set(e.pointerId, now);
        this.later();
      });
      c.addEventListener('wheel', (e) => {
        e.preventDefault();
        this.zoom_at(Math.exp(-0.0015 * e.deltaY), ...place(e));
        this.later();
      }, {passive: false});
      c.addEventListener('keydown', (e) => {
        const turn = {ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1],
          ArrowDown: [0, -0.1]}[e.key];
        if (turn) {
          this.yaw += turn[0];
          this.pitch = Math.min(Math.PI / 2, Math.max(0, this.pitch + turn[1]));
        } else if (e.key === '+' || e.key === '-') {
          this.zoom *= e.key === '+' ? 1.2 : 1 / 1.2;
        } else {
          return;
        }
        e.preventDefault();
        this.later();
      });
    }

    // Axes of the screen in the model: right, up, towards the eye.
    axes() {
      const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch),
        Math.sin(this.pitch)];
      return [[cy, sy, 0], [-sy * sp, cy * sp, cp], [sy * cp, -cy * cp, sp]];
    }
    corners() {
      const all = [];
      for (let i = 0; i < 8; ++i)
        all.push([0, 1, 2].map((k) =>
          (i >> k & 1 ? 0.5 : -0.5) * this.extent[k] * (k === 2 ? this.exaggeration : 1)));
      return all;
    }
    dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    // Pixels a millimetre so that all is seen.
    fit() {
      const [right, up] = this.axes();
      const reach = (axis) => Math.max(...this.corners().map((q) => Math.abs(this.dot(q, axis))));
      return 0.47 * Math.min(this.canvas.width / Math.max(1e-6, reach(right)),
        this.canvas.height / Math.max(1e-6, reach(up)));
    }
    move(dx_px, dy_px) {
      this.pan[0] += dx_px / (this.zoom * this.unit);
      this.pan[1] -= dy_px / (this.zoom * this.unit);
    }
    zoom_at(factor, x, y) {
      const before = this.zoom;
      this.zoom = Math.min(400, Math.max(0.2, this.zoom * factor));
      const k = 1 / (before * this.unit) - 1 / (this.zoom * this.unit);
      const ratio = this.canvas.width / this.canvas.clientWidth;
      this.pan[0] -= (x * ratio - 0.5 * this.canvas.width) * k;
      this.pan[1] += (y * ratio - 0.5 * this.canvas.height) * k;
    }
    reset(way) {
      this.yaw = way === 'oblique' ? -0.5 : 0;
      this.pitch = way === 'above' ? Math.PI / 2 : way === 'front' ? 0 : 0.7;
      this.zoom = 1;
      this.pan = [0, 0];
      this.unit = 0;
      this.rescale();
    }

    value(p, i) {
      if (this.mode === 'height') return this.low[2] + p.places[3 * i + 2] / 65535 * this.size[2];
      return p.values[this.mode][i];
    }
    // 2nd to 98th percentile of what is shown.
    rescale() {
      const all = [];
      for (const p of this.scene.programs) {
        if (!p.shown || (this.mode !== 'height' && !p.values[this.mode])) continue;
        for (let i = 0; i < p.count; ++i)
          if (p.kinds[i] === CUT) all.push(this.value(p, i));
      }
      const sorted = Float64Array.from(all).sort();
      const at = (share) => sorted.length ? sorted[Math.floor(share * (sorted.length - 1))] : 0;
      let [low, high] = [at(0.02), at(0.98)];
      const least = Math.max(1e-3 * Math.abs(high), 1e-9);
      if (high - low <= least) [low, high] = [at(0), at(1)];
      this.constant = high - low <= least;
      if (this.constant) low = high - 1;
      this.scale = [low, high];
      this.describe();
      this.later();
    }
    describe() {
      const [low, high] = this.scale;
      const units = {height: 'height of the tip, mm', feed: 'feed, mm/min',
        engagement: 'engagement, mm³ removed per mm of path'};
      const bar = element('div', {class: 'bar'});
      bar.style.background = `linear-gradient(to right, ${COLOURS.map((c) => `rgb(${c})`).join(',')})`;
      const marks = element('div', {class: 'marks'});
      const put = (share, text) => {
        const mark = element('span', {}, text);
        mark.style.left = `${100 * share}%`;
        marks.append(mark);
      };
      if (this.constant) {
        bar.style.background = `rgb(${COLOURS[5]})`;
        put(0.5, `${short(this.mode === 'engagement' ? 10 ** (high / 8191.875 - 4) : high)} everywhere`);
      } else if (this.mode === 'engagement') {
        const decade = (v) => v / 8191.875 - 4, code = (v) => (v + 4) * 8191.875;
        const marked = [];
        for (let e = Math.floor(decade(low)); e <= Math.ceil(decade(high)); ++e)
          for (const f of [1, 2, 5]) marked.push([e + Math.log10(f), f]);
        let within = marked.filter(([v]) => v >= decade(low) && v <= decade(high));
        if (within.length > 6) within = within.filter(([, f]) => f === 1);
        if (within.length === 0) within = [[decade(low)], [decade(high)]];
        for (const [v] of within) put((code(v) - low) / (high - low), short(10 ** v));
      } else {
        for (const v of niceTicks(low, high, 5)) put((v - low) / (high - low), short(v));
      }
      this.legend.replaceChildren(element('div', {}, units[this.mode]), bar, marks);
      const shown = this.scene.programs.filter((p) => p.shown);
      const deviation = Math.max(0, ...shown.map((p) => p.deviation_mm));
      const cell = Math.max(0, ...shown.map((p) => p.cell_mm));
      this.note.textContent = `Of passes closer together than ${short(cell)} mm the first is shown, ` +
        `within ${deviation.toPrecision(2)} mm of the path.` +
        (this.scene.ground ? ' Ground: the lowest of the design around each point.' : '') +
        ' Drag to turn, shift or two fingers to move, wheel or pinch to zoom.';
    }

    later() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.draw(); });
    }
    draw() {
      const gl = this.gl, c = this.canvas, ratio = Math.min(3, window.devicePixelRatio || 1);
      const w = Math.max(1, Math.round(c.clientWidth * ratio));
      const h = Math.max(1, Math.round(c.clientHeight * ratio));
      if (c.width !== w || c.height !== h) { c.width = w; c.height = h; this.unit = 0; }
      if (!this.unit) this.unit = this.fit();
      gl.viewport(0, 0, w, h);
      const dark = window.matchMedia('(prefers-color-scheme: dark)').matches;
      gl.clearColor(...(dark ? [0.09, 0.1, 0.11, 1] : [0.96, 0.965, 0.97, 1]));
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);

      // Parallel projection, heights exaggerated about the middle.
      const [right, up, eye] = this.axes(), k = this.zoom * this.unit, e = this.exaggeration;
      const depth = Math.hypot(this.size[0], this.size[1], e * this.size[2]) + 1e-6;
      const rows = [[right, 2 * k / w, this.pan[0]], [up, 2 * k / h, this.pan[1]],
        [eye, -1 / depth, 0]];
      const view = new Float32Array(16);
      rows.forEach(([axis, f, shift], i) => {
        const a = [axis[0], axis[1], axis[2] * e];
        for (let j = 0; j < 3; ++j) view[4 * j + i] = f * a[j];
        view[12 + i] = f * (shift - this.dot(a, this.centre));
      });
      view[15] = 1;

      if (this.ground && this.show_ground) {
        const g = this.scene.ground, p = this.ground;
        gl.useProgram(p.program);
        gl.uniformMatrix4fv(p.at('view'), false, view);
        gl.uniform2fv(p.at('origin'), g.origin_mm);
        gl.uniform2fv(p.at('step_mm'), g.step_mm);
        gl.uniform1i(p.at('cols'), g.cols);
        gl.uniform1f(p.at('exaggeration'), e);
        gl.uniform3fv(p.at('tint'), dark ? [0.42, 0.43, 0.45] : [0.86, 0.85, 0.83]);
        for (const [name, buffer, n] of [['z', this.ground_z, 1], ['slope', this.ground_slope, 2]]) {
          const at = p.attribute(name);
          gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
          gl.enableVertexAttribArray(at);
          gl.vertexAttribPointer(at, n, gl.FLOAT, false, 0, 0);
          gl.vertexAttribDivisor(at, 0);
        }
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.ground_index);
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(1, 1);
        gl.drawElements(gl.TRIANGLES, this.ground_count, gl.UNSIGNED_INT, 0);
        gl.disable(gl.POLYGON_OFFSET_FILL);
        for (const name of ['z', 'slope']) gl.disableVertexAttribArray(p.attribute(name));
      }

      const p = this.lines;
      gl.useProgram(p.program);
      gl.uniformMatrix4fv(p.at('view'), false, view);
      gl.uniform3fv(p.at('low'), this.low);
      gl.uniform3fv(p.at('size'), this.size);
      gl.uniform2f(p.at('half_px'), 0.5 * w, 0.5 * h);
      gl.uniform2fv(p.at('scale'), this.scale);
      gl.uniform1i(p.at('mode'), this.mode === 'height' ? 0 : 1);
      gl.uniform3fv(p.at('colours'), this.colours);
      gl.uniform3fv(p.at('rapid'), RAPID);
      const shown = this.scene.programs.filter((q) => q.shown);
      let left = Math.round(this.progress * shown.reduce((n, q) => n + q.count, 0));
      for (const q of shown) {
        const count = Math.min(left, q.count);
        left -= count;
        if (count < 2) continue;
        // Segment i goes from point i to point i + 1 and has what point i + 1 has.
        const put = (name, buffer, n, type, norm, offset) => {
          const at = p.attribute(name);
          if (at < 0) return;
          gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
          gl.enableVertexAttribArray(at);
          gl.vertexAttribPointer(at, n, type, norm, 0, offset);
          gl.vertexAttribDivisor(at, 1);
        };
        put('from', q.place_buffer, 3, gl.UNSIGNED_SHORT, true, 0);
        put('to', q.place_buffer, 3, gl.UNSIGNED_SHORT, true, 6);
        put('kind', q.kind_buffer, 1, gl.UNSIGNED_BYTE, false, 1);
        put('value', q.value_buffers[this.mode] || q.value_buffers.feed, 1, gl.UNSIGNED_SHORT, false, 2);
        const kinds = this.rapids ? [CUT, RAPID_KIND] : [CUT];
        for (const kind of kinds) {
          gl.uniform1f(p.at('drawn_kind'), kind);
          gl.uniform1f(p.at('width'), (kind === CUT ? 1.3 : 1.0) * ratio);
          gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count - 1);
        }
      }
      for (const name of ['from', 'to', 'kind', 'value']) {
        const at = p.attribute(name);
        if (at >= 0) { gl.vertexAttribDivisor(at, 0); gl.disableVertexAttribArray(at); }
      }
    }
  }

  window.maquetteViews = [];
  document.addEventListener('DOMContentLoaded', () => {
    for (const root of document.querySelectorAll('.pathview'))
      window.maquetteViews.push(new View(root));
  });
})();
