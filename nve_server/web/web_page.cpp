#include "telenano/nve_server/web/web_page.h"

namespace telenano::web {

const char* const kPageHtml = R"html(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Telenano: a running session</title>
<link rel="stylesheet" href="/view.css"></head><body>
<header><b id="mode">connecting</b> <span id="words"></span></header>
<div id="scene"><p id="note"></p></div>
<h2>Normal force, nN, last 20 s</h2><canvas id="normal" width="900" height="120"></canvas>
<h2>Lateral force, nN, last 20 s</h2><canvas id="lateral" width="900" height="120"></canvas>
<script src="/three.js"></script><script src="/view.js"></script></body></html>
)html";

const char* const kPageCss =
    R"css(body{margin:0 auto;max-width:940px;padding:0 12px;background:#14171c;color:#e8e8e8;font:16px sans-serif}
header{padding:10px 0}#mode{padding:2px 8px;background:#3b4a63;border-radius:3px}
#mode.afm{background:#a34b00}#mode.lost{background:#9c1c28}
#scene{height:420px;background:#0c0e12}#scene canvas{display:block}#note{margin:0;padding:12px}#note:empty{display:none}
h2{font-size:14px;font-weight:normal;margin:10px 0 2px}canvas{max-width:100%}#normal,#lateral{background:#0c0e12}
)css";

// The colours are points of viridis (van der Walt and Smith, 2015), which is perceptually even.
const char* const kPageJs = R"js('use strict';
const el = id => document.getElementById(id);
const MAP = [[68,1,84],[72,40,120],[62,74,137],[49,104,142],[38,130,142],[31,158,137],[53,183,121],[110,206,88],[181,222,43],[253,231,37]];
function colour(t) {
  const x = Math.min(1, Math.max(0, t)) * (MAP.length - 1), i = Math.min(MAP.length - 2, Math.floor(x)), f = x - i;
  return [0, 1, 2].map(k => (MAP[i][k] + f * (MAP[i + 1][k] - MAP[i][k])) / 255);
}
const CONTACT = ['free', 'van der Waals', 'non-contact', 'contact'];
const number = v => v.toFixed(2);
let three = null, latest = null, stale = false, marks, fetching = false;
const past = [];
function note(text) { el('note').textContent = text; }

function makeScene(grid) {
  const box = el('scene'), w = box.clientWidth, h = box.clientHeight;
  const renderer = new THREE.WebGLRenderer({antialias: true});
  renderer.setSize(w, h);
  box.appendChild(renderer.domElement);
  const scene = new THREE.Scene();
  const sx = (grid.nx - 1) * grid.dx, sy = (grid.ny - 1) * grid.dy, size = Math.max(sx, sy);
  const cx = grid.x0 + sx / 2, cy = grid.y0 + sy / 2;
  let low = Infinity, high = -Infinity;
  const g = new THREE.BufferGeometry(), index = [];
  for (let j = 0; j < grid.ny; ++j) for (let i = 0; i < grid.nx; ++i) {
    if (i + 1 < grid.nx && j + 1 < grid.ny) {
      const a = j * grid.nx + i, b = a + grid.nx;
      index.push(a, a + 1, b, b, a + 1, b + 1);
    }
  }
  const nodes = () => new THREE.BufferAttribute(new Float32Array(3 * grid.nx * grid.ny), 3);
  g.setAttribute('position', nodes());
  g.setAttribute('color', nodes());
  g.setIndex(index);
  const shape = z => {
    low = Infinity, high = -Infinity;
    for (const one of z) { low = Math.min(low, one); high = Math.max(high, one); }
    const {position, color} = g.attributes;
    for (let j = 0, k = 0; j < grid.ny; ++j) for (let i = 0; i < grid.nx; ++i, ++k) {
      position.setXYZ(k, grid.x0 + i * grid.dx, grid.y0 + j * grid.dy, z[k]);
      color.setXYZ(k, ...colour(high > low ? (z[k] - low) / (high - low) : 0.4));
    }
    position.needsUpdate = color.needsUpdate = true;
    g.computeVertexNormals();
    g.computeBoundingSphere();
    stale = true;
  };
  shape(grid.z);
  scene.add(new THREE.Mesh(g, new THREE.MeshLambertMaterial({vertexColors: THREE.VertexColors, side: THREE.DoubleSide})));
  scene.add(new THREE.AmbientLight(0xffffff, 0.75));
  const sun = new THREE.DirectionalLight(0xffffff, 0.45);
  sun.position.set(-1, -1, 2);
  scene.add(sun);
  const camera = new THREE.PerspectiveCamera(40, w / h, size / 1000, size * 20);
  camera.up.set(0, 0, 1);
  let turn = -1.1, tilt = 0.6, far = 1.7 * size;
  const look = () => {
    camera.position.set(cx + far * Math.cos(tilt) * Math.cos(turn), cy + far * Math.cos(tilt) * Math.sin(turn), high + far * Math.sin(tilt));
    camera.lookAt(new THREE.Vector3(cx, cy, high));
    stale = true;
  };
  look();
  const d = renderer.domElement;
  d.onpointermove = e => { if (e.buttons) { turn -= e.movementX / 150; tilt = Math.min(1.5, Math.max(0.05, tilt + e.movementY / 150)); look(); } };
  d.onwheel = e => { e.preventDefault(); far *= Math.exp(e.deltaY / 800); look(); };
  const tip = new THREE.Mesh(new THREE.ConeBufferGeometry(size / 50, size / 14, 24), new THREE.MeshLambertMaterial({color: 0xffffff}));
  tip.geometry.rotateX(-Math.PI / 2);
  tip.geometry.translate(0, 0, size / 28);
  scene.add(tip);
  const arrow = new THREE.ArrowHelper(new THREE.Vector3(0, 0, 1), new THREE.Vector3(), size / 10, 0xff5a36);
  for (const part of [arrow.line, arrow.cone]) { part.material.depthTest = false; part.renderOrder = 1; }  // not hidden in the tip
  scene.add(arrow);
  // One buffer for good: a new one for each picture would stay in the graphics memory.
  const LENGTH = 300, trail = new THREE.BufferGeometry(), place = new THREE.BufferAttribute(new Float32Array(3 * LENGTH), 3);
  trail.setAttribute('position', place);
  trail.setDrawRange(0, 0);
  const line = new THREE.Line(trail, new THREE.LineBasicMaterial({color: 0x5ad7ff, depthTest: false}));
  line.frustumCulled = false;  // its bounds would be those of its first picture
  scene.add(line);
  let way = 0;
  return {shape, draw: tipNow => {
    tip.visible = arrow.visible = !!tipNow;
    if (tipNow) {
      const at = new THREE.Vector3(...tipNow.p), f = new THREE.Vector3(...tipNow.f), n = f.length();
      tip.position.copy(at);
      arrow.visible = n > 1e-3;
      arrow.position.copy(at);
      if (n > 1e-3) { arrow.setDirection(f.divideScalar(n)); arrow.setLength(size / 30 + size / 5 * n / (n + 10), size / 60, size / 90); }
      if (way === LENGTH) place.array.copyWithin(0, 3); else ++way;
      place.array.set(tipNow.p, 3 * (way - 1));
      place.needsUpdate = true;
      trail.setDrawRange(0, way);
    }
    renderer.render(scene, camera);
  }};
}

function chart(id, of) {
  const canvas = el(id), g = canvas.getContext('2d'), w = canvas.width, h = canvas.height;
  g.clearRect(0, 0, w, h);
  let low = 0, high = 0;
  for (const s of past) { low = Math.min(low, of(s)); high = Math.max(high, of(s)); }
  if (high - low < 1) high = low + 1;
  const y = v => h - 6 - (h - 12) * (v - low) / (high - low), now = performance.now();
  g.strokeStyle = '#555'; g.beginPath(); g.moveTo(0, y(0)); g.lineTo(w, y(0)); g.stroke();
  g.strokeStyle = '#ffd25a'; g.beginPath();
  for (const s of past) g.lineTo(w - (now - s.at) / 20000 * w, y(of(s)));
  g.stroke();
  g.fillStyle = '#ccc'; g.font = '13px sans-serif'; g.fillText(number(high), 4, 14); g.fillText(number(low), 4, h - 4);
}

// Drawing goes by the screen, not by what comes: a slow machine draws fewer pictures, and stays at the newest.
function draw() {
  requestAnimationFrame(draw);
  if (!stale || !latest) return;
  stale = false;
  chart('normal', s => s.n);
  chart('lateral', s => s.l);
  if (three) three.draw(latest.tips[0]);
}

function show(state) {
  el('mode').textContent = state.mode;
  el('mode').className = state.mode === 'AFM' ? 'afm' : '';
  const tip = state.tips[0];
  const many = state.sessions === 1 ? '1 session' : state.sessions + ' sessions';
  el('words').textContent = many + (tip ? ' · ' + (CONTACT[tip.c] || '') + ' · normal ' + number(tip.f[2]) + ' nN, lateral ' +
    number(Math.hypot(tip.f[0], tip.f[1])) + ' nN · tip at ' + tip.p.map(v => v.toFixed(1)).join(', ') + ' nm' +
    (tip.e ? ' · FAULT' : '') : ' · no tip moves');
  if (tip) past.push({at: performance.now(), n: tip.f[2], l: Math.hypot(tip.f[0], tip.f[1])});
  while (past.length && performance.now() - past[0].at > 20000) past.shift();
  latest = state;
  stale = true;
  if (three && state.marks !== marks && !fetching) remark(state.marks);
}

// Marks come faster than they need be drawn: the surface again, at most twice a second.
function remark(now) {
  fetching = true;
  fetch('/surface').then(r => r.arrayBuffer()).then(b => { three.shape(gridOf(b).z); marks = now; }).catch(() => {})
    .finally(() => setTimeout(() => fetching = false, 500));
}

function gridOf(b) {
  const v = new DataView(b), f = k => v.getFloat32(k, true);
  return {nx: v.getUint32(4, true), ny: v.getUint32(8, true), dx: f(12), dy: f(16), x0: f(20), y0: f(24), z: new Float32Array(b, 28)};
}

function lost() {
  el('mode').textContent = 'CONNECTION LOST';
  el('mode').className = 'lost';
  el('words').textContent = 'What you see is old. The server has ended, or all its places are taken. Reload to try again.';
}

fetch('/surface').then(r => r.arrayBuffer()).then(b => {
  const grid = gridOf(b);
  if (!grid.nx) return note('The surface of this session is not known here.');
  if (!window.THREE) return note('No picture: the server lacks the package libjs-three (apt install libjs-three).');
  three = makeScene(grid);
}).catch(e => note('No picture: ' + e.message));
const socket = new WebSocket('ws://' + location.host + '/live');
socket.onmessage = m => show(JSON.parse(m.data));
socket.onclose = lost;
requestAnimationFrame(draw);
)js";

}  // namespace telenano::web
