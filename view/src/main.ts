// SPDX-License-Identifier: GPL-3.0-or-later
// The page of `maquette view`: what the folder holds, looked at and asked.

import { carries, damaged, leftOut, madeBy } from './carried';
import { fileUrl, getContents, getJson, getProfile, type Contents, type Stone, type Triple } from './contents';
import { addOption, byId } from './elements';
import { FieldColours } from './field_colours';
import { Frames } from './frames';
import { GroundMaterial } from './ground_material';
import { drawProfile } from './profile';
import { Stage } from './stage';
import { choices, type Surface, type SurfaceChoice } from './surface';
import { Toolpath } from './toolpath';

const kMostProblems = 8;

const told = new Set<string>();
function tell(problem: string): void {
  if (told.has(problem)) return;
  told.add(problem);
  const list = byId('problems'), item = document.createElement('li');
  if (list.children.length === kMostProblems) list.firstElementChild!.remove();
  item.textContent = problem;
  list.append(item);
}
const say = (text: string) => { byId('readout').textContent = text; };

class Page {
  private readonly material = new GroundMaterial();
  private readonly offered: SurfaceChoice[];
  private readonly opened = new Map<string, Promise<Surface>>();
  private readonly colours: FieldColours;
  private readonly path: Toolpath;
  private readonly frames: Frames;
  private readonly stones = new Map<number, Stone>();
  private profileFrom: Triple | null = null;
  private profileEnds: [Triple, Triple] | null = null;
  private readonly select = {
    surface: byId<HTMLSelectElement>('surface'), beside: byId<HTMLSelectElement>('beside'),
    field: byId<HTMLSelectElement>('field'), fieldBeside: byId<HTMLSelectElement>('field-beside'),
    stone: byId<HTMLSelectElement>('stone'),
  };
  private readonly slider = {
    exaggeration: byId<HTMLInputElement>('exaggeration'), azimuth: byId<HTMLInputElement>('azimuth'),
    elevation: byId<HTMLInputElement>('elevation'),
  };

  constructor(private readonly contents: Contents, private readonly stage: Stage) {
    const changed = () => this.stage.later();
    this.offered = choices(contents, this.material, tell, () => this.stage.arrived());
    this.colours = new FieldColours(this.material, this.stage.renderer, () => { changed(); this.remember(); });
    this.path = new Toolpath(contents.paths, () => { changed(); this.remember(); }, tell);
    this.stage.relief.add(this.path.group);
    this.frames = new Frames(contents.frames, this.stage, () => this.remember(), tell);
    this.stage.before = () => this.path.advance();
    this.stage.dress = (pane) => this.colours.dress(pane);
    this.stage.shown = () => this.firstPicture();
    this.stage.stirs = () => { document.documentElement.dataset.state = 'loading'; };
    this.stage.still = () => { document.documentElement.dataset.state = 'still'; this.remember(); };
    this.fill();
    this.listen();
  }

  /** When something of the surface was first to be seen, ms after the page was asked for. */
  private firstPicture(): void {
    const root = document.documentElement.dataset;
    const calls = this.stage.renderer.info.render.triangles;
    if (!root.firstPicture && calls > 0) root.firstPicture = String(Math.round(performance.now()));
  }

  private fill(): void {
    byId('title').textContent = this.contents.name;
    document.title = `${this.contents.name} – maquette view`;
    for (const c of this.offered) {
      addOption(this.select.surface, c.id, c.label);
      addOption(this.select.beside, c.id, c.label);
    }
    for (const f of this.contents.fields) if (f.kind !== 'height') addOption(this.select.field, f.path, f.path);
    byId('colours').hidden = this.select.field.options.length < 2;
    const links = this.contents.reports.concat(this.contents.manifest ?? []).map((path) => {
      const a = document.createElement('a');
      a.href = fileUrl(path);
      a.textContent = path;
      return a;
    });
    byId('reports').replaceChildren(...links);
    byId('carried-note').hidden = !carries;
    if (carries)
      byId('carried-note').textContent = `This page has its data in itself (${madeBy}) and asks nothing of any network. `
        + (leftOut.length ? `Left out, for they did not fit: ${leftOut.join(', ')}. ` : '')
        + (damaged.length ? `Left out, for they could not be read: ${damaged.join(', ')}.` : '')
        + (leftOut.length + damaged.length ? '' : 'Nothing was left out.');
    const plan = this.contents.tilesets.find((t) => t.stones)?.stones ?? this.contents.plans[0];
    if (plan) this.readStones(plan).catch((error: Error) => tell(`${plan}: ${error.message}`));
  }

  private async readStones(plan: string): Promise<void> {
    for (const s of (await getJson<{ stones: Stone[] }>(plan)).stones) {
      this.stones.set(s.number, s);
      addOption(this.select.stone, String(s.number), `${s.number}: ${s.scale_mm.toFixed(2)} mm`);
    }
    byId('stones-box').hidden = this.stones.size === 0;
  }

  private open(id: string): Promise<Surface> {
    let surface = this.opened.get(id);
    if (!surface) {
      surface = this.offered.find((c) => c.id === id)!.open().then((s) => { this.stage.relief.add(s.group); return s; });
      surface.catch(() => this.opened.delete(id));
      this.opened.set(id, surface);
    }
    return surface;
  }

  /** Shows what the two lists say. */
  private async showSurfaces(): Promise<void> {
    document.documentElement.dataset.state = 'loading';
    const ids = [this.select.surface.value, this.select.beside.value].filter((id) => id !== '');
    const results = await Promise.allSettled(ids.map((id) => this.open(id)));
    const surfaces = results.flatMap((r, i) => {
      if (r.status === 'fulfilled') return [r.value];
      tell(`${ids[i]} cannot be shown: ${(r.reason as Error).message}`);
      return [];
    });
    for (const other of await Promise.all(this.opened.values())) other.group.visible = false;
    for (const s of surfaces) s.group.visible = true;
    const first = !this.stage.panes.some((p) => p);
    const fields = this.colours.entries;
    // One surface with two fields is seen twice.
    if (surfaces.length === 1 && fields.length === 2) surfaces.push(surfaces[0]!);
    this.stage.panes = surfaces.length ? surfaces : [null];
    byId('surface-note').textContent = [...new Set(surfaces.map((s) => s.note))].join(' ');
    const names = [byId('left-name'), byId('right-name')];
    names.forEach((name, i) => { name.hidden = surfaces.length < 2; name.textContent = fields.length === 2
      ? fields[i]!.path : surfaces[i]?.name ?? ''; });
    if (first && surfaces[0] && !this.viewGiven) this.stage.look(surfaces[0].box, 'oblique');
    this.stage.later();
  }
  private viewGiven = false;

  /** Colours as the two lists say; beside a field only what has its scale. */
  private async showFields(): Promise<void> {
    const { field, fieldBeside } = this.select, find = (path: string) => this.contents.fields.find((f) => f.path === path);
    const first = find(field.value), wanted = fieldBeside.value;
    const alike = this.contents.fields.filter((f) => first && f !== first && f.kind === first.kind && f.unit === first.unit);
    fieldBeside.replaceChildren(new Option('nothing', ''), ...alike.map((f) => new Option(f.path, f.path)));
    fieldBeside.value = alike.some((f) => f.path === wanted) ? wanted : '';
    byId('field-beside-label').hidden = alike.length === 0;
    const second = find(fieldBeside.value);
    await this.colours.show(first ? second ? [first, second] : [first] : []);
    await this.showSurfaces();
  }

  private listen(): void {
    const { stage, slider, select } = this, canvas = stage.canvas;
    const report = (error: Error) => tell(error.message);
    select.surface.addEventListener('change', () => { this.showSurfaces().catch(report); });
    select.beside.addEventListener('change', () => { this.showSurfaces().catch(report); });
    select.field.addEventListener('change', () => { this.showFields().catch(report); });
    select.fieldBeside.addEventListener('change', () => { this.showFields().catch(report); });
    select.stone.addEventListener('change', () => this.showStone(+select.stone.value || null, true));
    for (const input of Object.values(slider)) input.addEventListener('input', () => { this.setLight(); this.remember(); });
    byId('oblique').addEventListener('click', () => this.look('oblique'));
    byId('above').addEventListener('click', () => this.look('above'));
    const mode = byId('profile-mode');
    mode.addEventListener('click', () => {
      const on = mode.getAttribute('aria-pressed') !== 'true';
      mode.setAttribute('aria-pressed', String(on));
      this.profileFrom = null;
      if (!on) { byId('profile').hidden = true; this.profileEnds = null; stage.setMarks([]); }
      say(on ? 'Profile: click where it begins.' : 'Click the surface for its coordinates and height.');
    });
    byId('screenshot').addEventListener('click', () => { this.save().catch(report); });
    byId('link').addEventListener('click', () => {
      this.writeHash();
      navigator.clipboard.writeText(location.href).then(() => say('The address of this view is copied.'),
        () => say('Copy the address of this page: it is this view.'));
    });
    let down: { x: number; y: number } | null = null;
    canvas.addEventListener('pointerdown', (e) => { down = e.button === 0 ? { x: e.clientX, y: e.clientY } : null; });
    canvas.addEventListener('pointerup', (e) => {
      if (down && Math.hypot(e.clientX - down.x, e.clientY - down.y) < 4) {
        const box = canvas.getBoundingClientRect();
        this.ask(e.clientX - box.left, e.clientY - box.top).catch(report);
      }
      down = null;
    });
    canvas.addEventListener('keydown', (e) => {
      if (e.key === 'Enter') this.ask(0.5 * stage.paneSize()[0], 0.5 * stage.paneSize()[1]).catch(report);
      else if (!stage.key(e)) return;
      e.preventDefault();
    });
    canvas.addEventListener('webglcontextlost', () => tell('The browser has taken the graphics away; load the page again.'));
    window.addEventListener('hashchange', () => { if (location.hash !== this.written) this.readHash().catch(report); });
  }

  private look(from: 'oblique' | 'above'): void {
    const box = this.stage.panes[0]?.box;
    this.frames.show('', true);
    if (box) this.stage.look(box, from);
  }

  private setLight(): void {
    const { exaggeration, azimuth, elevation } = this.slider;
    const show = (input: HTMLInputElement, text: string) => {
      (input.nextElementSibling as HTMLOutputElement).value = text;
      input.setAttribute('aria-valuetext', text);
    };
    show(exaggeration, `${(+exaggeration.value).toFixed(1)}`);
    show(azimuth, `${azimuth.value}°`);
    show(elevation, `${elevation.value}°`);
    if (this.stage.exaggeration !== +exaggeration.value) this.stage.exaggeration = +exaggeration.value;
    this.stage.setSun(+azimuth.value, +elevation.value);
  }

  private async ask(x: number, y: number): Promise<void> {
    const camera = byId('profile-mode').getAttribute('aria-pressed') === 'true' ? '' : this.frames.at(x, y);
    if (camera) {
      this.frames.open(camera);
      say(`Camera ${camera}.`);
      return;
    }
    const met = await this.stage.ask(x, y);
    if (!met) { say('There is no surface.'); return; }
    const { surface, hit } = met, [px, py, pz] = hit.place;
    const profile = byId('profile-mode').getAttribute('aria-pressed') === 'true';
    const stone = hit.stone ?? this.stoneAt(px, py);
    let exact: number | null = null, why = 'the full resolution has a void here';
    if (hit.stone === null && surface.heights)
      try {
        exact = (await surface.heights([px, py], [px, py], 1)).values[0] ?? null;
      } catch (error) {
        why = 'the full resolution cannot be read';
        tell(carries ? (error as Error).message : `${(error as Error).message}; make it again`);
      }
    const z = exact ?? pz, place: Triple = [px, py, z];
    let text = `x ${px.toFixed(3)}, y ${py.toFixed(3)}, z ${z.toFixed(3)} mm`;
    if (!surface.heights) text = `x ${px.toFixed(3)}, y ${py.toFixed(3)} mm`;
    else if (hit.stone !== null) text += ' on a stone';
    else if (exact === null) text += ` as drawn; ${why}`;
    for (const field of this.colours.entries) text += `; ${await this.fieldAt(field.path, px, py, field.unit)}`;
    this.showStone(stone, false);
    if (stone !== null) text += `; stone ${stone}`;
    if (profile && !this.profileFrom) {
      this.profileFrom = place;
      this.stage.setMarks([place]);
      say(`${text}. Profile: click where it ends.`);
      return;
    }
    if (profile && this.profileFrom) {
      this.profileEnds = [this.profileFrom, place];
      this.profileFrom = null;
      await this.drawProfile();
    } else {
      this.stage.setMarks([place]);
    }
    say(text);
  }

  private async fieldAt(path: string, x: number, y: number, unit: string): Promise<string> {
    const v = (await getProfile(path, [x, y], [x, y], 1))[0] ?? this.colours.nearest(path, x, y);
    return v === null ? `${path}: no value` : `${path} ${v > 0 ? '+' : ''}${v.toFixed(4)} ${unit}`;
  }

  private async drawProfile(): Promise<void> {
    if (!this.profileEnds) return;
    this.stage.setMarks(this.profileEnds);
    await drawProfile([...new Set(this.stage.panes)].filter((p): p is Surface => p !== null), ...this.profileEnds);
    this.remember();
  }

  /** Of the plan, where a raster shows the stones' upper sides only. */
  private stoneAt(x: number, y: number): number | null {
    for (const s of this.stones.values())
      if (Math.hypot(s.translation_mm[0] - x, s.translation_mm[1] - y) <= 0.5 * s.scale_mm) return s.number;
    return null;
  }

  private showStone(number: number | null, approach: boolean): void {
    const s = number === null ? undefined : this.stones.get(number), table = byId<HTMLTableElement>('stone-data');
    this.select.stone.value = s ? String(s.number) : '';
    table.replaceChildren();
    if (!s) return;
    const row = (name: string, value: string) => {
      const r = table.insertRow();
      r.insertCell().textContent = name;
      r.insertCell().textContent = value;
    };
    row('number', String(s.number));
    row('equivalent diameter', `${s.scale_mm.toFixed(3)} mm`);
    row('x, y, z', `${s.translation_mm.map((v) => v.toFixed(2)).join(', ')} mm`);
    row('embedded', `${s.embedded_depth_mm.toFixed(3)} mm`);
    row('quaternion w, x, y, z', s.rotation_wxyz.map((v) => v.toFixed(4)).join(', '));
    if (!approach) return;
    const { camera, controls } = this.stage, [x, y, z] = s.translation_mm;
    const away = camera.position.clone().sub(controls.target).setLength(25 * s.scale_mm);
    controls.target.set(x, y, z * this.stage.exaggeration);
    camera.position.copy(controls.target).add(away);
    controls.update();
    this.stage.setMarks([[x, y, z + 0.5 * s.scale_mm]]);
    say(`Stone ${s.number}.`);
  }

  private async save(): Promise<void> {
    const blob = await this.stage.picture();
    if (!blob) throw new Error('The browser could not make a picture.');
    const a = document.createElement('a');
    a.href = URL.createObjectURL(blob);
    a.download = `${this.contents.name}.png`;
    a.click();
    setTimeout(() => URL.revokeObjectURL(a.href), 10_000);
    say(`${a.download} is among your downloads.`);
  }

  // The view as the address has it.
  private written = '';
  private due = 0;
  private remember(): void {
    window.clearTimeout(this.due);
    this.due = window.setTimeout(() => this.writeHash(), 300);
  }
  private writeHash(): void {
    if (!this.stage.panes[0] || this.path.playing) return;
    const p = new URLSearchParams(), list = (v: number[]) => v.map((x) => Number(x.toFixed(3))).join(',');
    const { camera, controls } = this.stage;
    p.set('surface', this.select.surface.value);
    if (this.select.beside.value) p.set('beside', this.select.beside.value);
    p.set('from', list(camera.position.toArray()));
    p.set('to', list(controls.target.toArray()));
    p.set('sun', `${this.slider.azimuth.value},${this.slider.elevation.value}`);
    p.set('times', this.slider.exaggeration.value);
    if (this.colours.entry) {
      p.set('field', this.colours.entry.path);
      if (this.colours.entries[1]) p.set('field_beside', this.colours.entries[1].path);
      p.set('limit', String(this.colours.limit));
      if (this.colours.brush.some(Number.isFinite)) p.set('brush', this.colours.brush.join(','));
    }
    if (this.path.name) { p.set('program', this.path.name); p.set('time', this.path.time.toFixed(4)); }
    if (this.frames.current) p.set('frame', this.frames.current);
    if (this.frames.pictured) p.set('photo', this.frames.pictured);
    if (this.profileEnds) p.set('profile', list(this.profileEnds.flat()));
    this.written = `#${p}`;
    try {
      history.replaceState(null, '', this.written);
    } catch { // some browsers let a file have no history
      location.replace(this.written);
    }
  }

  async readHash(): Promise<void> {
    const p = new URLSearchParams(location.hash.slice(1)), numbers = (key: string) => (p.get(key) ?? '').split(',').map(Number);
    const choose = (select: HTMLSelectElement, value: string | null) => {
      if (value !== null && [...select.options].some((o) => o.value === value)) select.value = value;
    };
    choose(this.select.surface, p.get('surface'));
    choose(this.select.beside, p.get('beside') ?? '');
    const [azimuth, elevation] = numbers('sun');
    if (p.has('sun') && Number.isFinite(azimuth! + elevation!)) {
      this.slider.azimuth.value = String(azimuth);
      this.slider.elevation.value = String(elevation);
    }
    if (+(p.get('times') ?? 0) > 0) this.slider.exaggeration.value = p.get('times')!;
    this.setLight();
    const from = numbers('from'), to = numbers('to');
    this.viewGiven = from.length === 3 && to.length === 3 && [...from, ...to].every(Number.isFinite);
    await this.showSurfaces();
    if (this.viewGiven) {
      this.stage.camera.position.set(from[0]!, from[1]!, from[2]!);
      this.stage.controls.target.set(to[0]!, to[1]!, to[2]!);
      this.stage.controls.update();
    }
    const field = this.contents.fields.find((f) => f.path === p.get('field') && f.kind !== 'height');
    if (field) {
      this.select.field.value = field.path;
      await this.showFields();
      choose(this.select.fieldBeside, p.get('field_beside') ?? '');
      if (this.select.fieldBeside.value) await this.showFields();
      if (+(p.get('limit') ?? 0) > 0) this.colours.limit = +p.get('limit')!;
      const brush = numbers('brush');
      if (p.has('brush') && brush.length === 2) this.colours.brush = [brush[0]!, brush[1]!];
      this.colours.apply();
    }
    if (p.has('program')) {
      this.path.time = Math.min(1, Math.max(0, +(p.get('time') ?? 1) || 0));
      await this.path.show(p.get('program')!);
    }
    if (p.has('frame')) this.frames.show(p.get('frame')!);
    if (p.has('photo')) this.frames.open(p.get('photo')!);
    const ends = numbers('profile');
    if (ends.length === 6 && ends.every(Number.isFinite)) {
      byId('profile-mode').setAttribute('aria-pressed', 'true');
      this.profileEnds = [ends.slice(0, 3) as Triple, ends.slice(3) as Triple];
      await this.drawProfile();
    }
    this.stage.later();
  }
}

async function begin(): Promise<void> {
  const asked = getContents(); // while the browser makes a context
  asked.catch(() => {});
  const canvas = byId<HTMLCanvasElement>('canvas');
  const gl = canvas.getContext('webgl2', { antialias: true, powerPreference: 'high-performance' });
  if (!gl) {
    tell('This browser shows no WebGL 2. Choose one that does, or allow hardware acceleration in its settings.');
    say('Nothing can be drawn.');
    return;
  }
  const stage = new Stage(canvas, gl);
  await new Page(await asked, stage).readHash();
}

begin().catch((error: Error) => tell(error.message));
