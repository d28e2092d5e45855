// Shows the bodies of a run in 3D: `data` is the JSON that `scene_view.rs` writes, `view` the element with canvas and controls.
function showScene(data, view) {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const corners = new Float32Array(bytes(data.corners)), triangles = new Uint16Array(bytes(data.triangles));
  const items = new Uint32Array(bytes(data.items)), poses = new Float32Array(bytes(data.poses));
  const canvas = view.querySelector("canvas"), label = view.querySelector("output");
  const [time, cut] = view.querySelectorAll("input"), play = view.querySelector("button");
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) { label.textContent = "This browser has no WebGL 2, which the view needs."; return; }

  // Triangles in the frames of their items: x, y, z, item.
  const count = items.length / 2, starts = [[0, 0]];
  data.shapes.forEach(([points, faces], k) => starts.push([starts[k][0] + points, starts[k][1] + faces]));
  const size = Array.from({ length: count }, (_, i) => 3 * data.shapes[items[2 * i]][1]).reduce((a, b) => a + b, 0);
  const vertices = new Float32Array(4 * size);
  let end = 0;
  for (let i = 0; i < count; i++) {
    const shape = items[2 * i], [first, face] = starts[shape];
    for (let k = 3 * face; k < 3 * (face + data.shapes[shape][1]); k++) {
      const corner = 3 * (first + triangles[k]);
      vertices.set([corners[corner], corners[corner + 1], corners[corner + 2], i], end);
      end += 4;
    }
  }

  const program = gl.createProgram();
  const compile = (kind, source) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  };
  // A pose is two texels: position and kind; quaternion.
  compile(gl.VERTEX_SHADER, `
    uniform highp sampler2D poses, before;
    uniform mat4 camera;
    uniform float cut, high;
    uniform vec3 shades[10];
    in vec4 vertex;
    out vec3 place, colour;
    void main() {
      int item = int(vertex.w), width = textureSize(poses, 0).x / 2;
      ivec2 at = ivec2(2 * (item % width), item / width);
      vec4 centre = texelFetch(poses, at, 0), turn = texelFetch(poses, at + ivec2(1, 0), 0);
      int kind = int(centre.w);
      float moved = distance(centre.xyz, texelFetch(before, at, 0).xyz) * 1e3;
      place = vertex.xyz + 2.0 * cross(turn.xyz, cross(turn.xyz, vertex.xyz) + turn.w * vertex.xyz) + centre.xyz;
      colour = kind == 0 ? shades[clamp(int(moved / high * 8.0), 0, 7)] : shades[7 + kind];
      gl_Position = kind != 1 && centre.y < cut ? vec4(2.0, 2.0, 2.0, 1.0) : camera * vec4(place, 1.0);
    }`);
  compile(gl.FRAGMENT_SHADER, `
    uniform vec3 eye;
    in vec3 place, colour;
    out vec4 pixel;
    void main() {
      vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
      float light = abs(dot(normal, normalize(eye - place))), above = 0.5 + 0.5 * normal.z * sign(dot(normal, eye - place));
      pixel = vec4(colour * (0.25 + 0.5 * light + 0.3 * above), 1.0);
    }`);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) { label.textContent = gl.getProgramInfoLog(program); return; }
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
  const vertex = gl.getAttribLocation(program, "vertex");
  gl.enableVertexAttribArray(vertex);
  gl.vertexAttribPointer(vertex, 4, gl.FLOAT, false, 0, 0);
  gl.enable(gl.DEPTH_TEST);
  const uniform = (name) => gl.getUniformLocation(program, name);

  const width = Math.min(count, 1024), height = Math.ceil(count / width), texels = new Float32Array(8 * width * height);
  const load = (unit, frame) => {
    for (let i = 0; i < count; i++) {
      const from = 7 * (frame * count + i);
      texels.set(poses.subarray(from, from + 3), 8 * i);
      texels[8 * i + 3] = items[2 * i + 1];
      texels.set(poses.subarray(from + 3, from + 7), 8 * i + 4);
    }
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 2 * width, height, 0, gl.RGBA, gl.FLOAT, texels);
  };
  ["poses", "before"].forEach((name, unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.uniform1i(uniform(name), unit);
  });
  load(1, 0);

  const [x, y, z] = data.size;
  let azimuth = -1.1, elevation = 0.45, target = [x / 2, y / 2, z / 2], shown = -1;
  let distance = 1.3 * Math.hypot(x, y, z);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const axes = () => {
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    return [[-sa, ca, 0], [-ca * se, -sa * se, ce], [ca * ce, sa * ce, se]];
  };
  const draw = () => {
    const ratio = window.devicePixelRatio || 1, style = getComputedStyle(view);
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    gl.viewport(0, 0, canvas.width, canvas.height);
    const colour = (name) => {
      const text = style.getPropertyValue(name).trim().slice(1);
      const digits = text.length === 3 ? [...text].map((c) => c + c) : text.match(/../g);
      return digits.map((c) => parseInt(c, 16) / 255);
    };
    gl.clearColor(...colour("--air"), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform3fv(uniform("shades"), ["--s0", "--s1", "--s2", "--s3", "--s4", "--s5", "--s6", "--s7", "--tool", "--block"].flatMap(colour));
    const frame = Number(time.value);
    if (frame !== shown) { load(0, frame); shown = frame; }
    label.textContent = data.frames[frame];
    const [right, up, back] = axes(), eye = target.map((t, k) => t + distance * back[k]);
    const f = 2.2, a = (f * canvas.height) / canvas.width, near = distance / 50, far = distance * 20;
    const c = (far + near) / (near - far), d = (2 * far * near) / (near - far);
    const camera = [0, 1, 2].flatMap((k) => [a * right[k], f * up[k], c * back[k], -back[k]]);
    camera.push(-a * dot(right, eye), -f * dot(up, eye), d - c * dot(back, eye), dot(back, eye));
    gl.uniformMatrix4fv(uniform("camera"), false, camera);
    gl.uniform3fv(uniform("eye"), eye);
    gl.uniform1f(uniform("high"), data.high);
    // Grains that bulge beyond a wall stay while nothing is cut.
    gl.uniform1f(uniform("cut"), Number(cut.value) > 0 ? Number(cut.value) * y : -1e9);
    gl.drawArrays(gl.TRIANGLES, 0, size);
  };
  let waiting = false;
  const redraw = () => {
    if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; draw(); }); }
  };
  canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("pointermove", (e) => {
    if (!e.buttons) return;
    if (e.shiftKey || e.buttons === 2) {
      const [right, up] = axes(), scale = distance / canvas.clientHeight;
      target = target.map((t, k) => t + scale * (e.movementY * up[k] - e.movementX * right[k]));
    } else {
      azimuth -= 0.008 * e.movementX;
      elevation = Math.max(-1.5, Math.min(1.5, elevation + 0.008 * e.movementY));
    }
    redraw();
  });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); distance *= Math.exp(0.001 * e.deltaY); redraw(); }, { passive: false });
  [time, cut].forEach((input) => input.addEventListener("input", redraw));
  let timer = 0;
  play.addEventListener("click", () => {
    clearInterval(timer);
    play.textContent = timer ? "Play" : "Pause";
    timer = timer ? 0 : setInterval(() => { time.value = (Number(time.value) + 1) % data.frames.length; redraw(); }, 150);
  });
  new ResizeObserver(redraw).observe(canvas);
}
