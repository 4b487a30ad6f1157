// The slider-crank, with what is missing marked on the body it acts on. Proportions are the machine's where the
// evidence gives them ({mechanism: {crank_length, rod_length, offset}}), else the nominal ones; the gap is drawn large.

// Channels whose sensor the first effect says is at fault; none where it is not one sensor's.
function faultyChannels() {
  const effect = list(DIAGNOSIS.effects)[0];
  if (effect?.kind !== "instrument") return [];
  return [effect.channel, ...Object.keys(dict(effect.parameters))].filter((name) => /^(crank|rod|slider|drive)_/.test(String(name)));
}

function mechanismDrawing(parent) {
  const mismatch = dict(DIAGNOSIS.mismatch), clearance = dict(DIAGNOSIS.clearance), size = dict(EVIDENCE.mechanism);
  const r = size.crank_length > 0 ? size.crank_length : 0.05, l = size.rod_length > r ? size.rod_length : 0.12;
  const offset = isNumber(size.offset) && Math.abs(size.offset) < l - r ? size.offset : 0;
  const found = mismatch.detected !== false && DIAGNOSIS.verdict !== "none";
  const effect = list(DIAGNOSIS.effects)[0], named = faultyChannels();
  const faulty = new Set(effect?.kind === "instrument" ? named : Object.keys(dict(mismatch.channels))); // nobody named: those that show it
  const body = !found ? null : effect?.kind === "instrument" ? "instrument" : mismatch.body, direction = String(mismatch.direction ?? "");
  const ranges = found ? list(mismatch.crank_angle_deg).filter((range) => list(range).length === 2) : [];
  const force = list(EVIDENCE.missing_force)[0] ?? DIAGNOSIS.free_form;
  const caption = effect ? words(effect.name) : DIAGNOSIS.verdict === "unknown" && force ? "unknown force" : "mismatch";
  const channels = new Set(list(DIAGNOSIS.recordings).flatMap((recording) => list(recording?.channels)).concat(list(dict(EVIDENCE.where).channels)));
  const guilty = found ? dict(mismatch.channels) : {};
  const joints = { B: ["B"], C: ["C"] }[clearance.joint] ?? (clearance.joint ? ["B", "C"].filter((name) => String(clearance.joint).includes(name)) : []);
  const inRange = (angle) => ranges.some(([a, b]) => angle >= a && angle <= b || angle + 360 <= b || angle - 360 >= a);

  const spoken = `Drawing of the slider-crank. ` + (body
    ? `Marked: ${body === "instrument" ? `the sensor of ${[...faulty].map(words).join(", ") || "the recorder"}` : `${words(body)}${direction ? `, direction ${direction}` : ""}`}, ${caption}` + (ranges.length ? `, at crank angles ${ranges.map(([a, b]) => `${text(a)} to ${text(b)} degrees`).join(" and ")}` : "") + "."
    : DIAGNOSIS.verdict === "unknown" ? "Nothing is marked: no place is known." : "Nothing is marked: the model explains the recordings.");
  let pose = () => {};
  const picture = figure(parent, spoken, draw, { className: "machine" });
  crank.follow((angle, from) => { pose(angle); if (from !== "slider") slider.value = Math.round(angle); turned.textContent = `${Math.round(angle)}°`; });

  // Turning: while the pointer rests on the drawing, by the button, or by the slider.
  let clock = null, hovered = false;
  const turned = h("output", {}, `${crank.angle}°`);
  const slider = h("input", { type: "range", min: 0, max: 360, step: 1, value: crank.angle, "aria-label": "Crank angle in degrees", oninput: (event) => { stop(); crank.turn(Number(event.target.value), "slider"); } });
  const play = h("button", { type: "button", class: "quiet", "aria-pressed": "false", onclick: () => (clock ? stop() : start()) }, "Turn");
  parent.append(h("div", { class: "turning" }, play, slider, turned));
  function start() {
    if (clock) return;
    let before = null;
    const step = (now) => { if (before !== null) crank.turn(crank.angle + ((now - before) * 360) / (inRange(crank.angle) ? 9000 : 4500)); before = now; clock = requestAnimationFrame(step); };
    clock = requestAnimationFrame(step);
    play.setAttribute("aria-pressed", "true"); play.textContent = "Stop";
  }
  function stop() { cancelAnimationFrame(clock); clock = null; play.setAttribute("aria-pressed", "false"); play.textContent = "Turn"; }
  picture.holder.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse" && !CALM.matches && !clock) { hovered = true; start(); } });
  picture.holder.addEventListener("pointerleave", () => { if (hovered) { hovered = false; stop(); } });

  parent.append(h("div", { class: "marks" },
    body && h("span", {}, h("i", { class: "swatch culprit" }), body === "instrument" ? "where the fault is" : "where the model falls short"),
    ranges.length > 0 && h("span", {}, h("i", { class: "swatch arc" }), "crank angles where it shows"),
    channels.size > 0 && h("span", {}, h("i", { class: "swatch sensor" }), "sensor"),
    Object.keys(guilty).length > 0 && h("span", {}, h("i", { class: "swatch sensor guilty" }), "sensor that shows it")));

  function draw(width) {
    const maxX = r + l + 0.62 * r, pixel = (maxX + 1.5 * r) / width; // about a pixel's size, for margins that hold text
    const minX = -1.22 * r - 38 * pixel, rim = 1.22 * r + 27 * pixel;
    const high = Math.max(rim, offset + 1.1 * r), low = -Math.max(rim, 1.1 * r - offset);
    const k = width / (maxX - minX), height = Math.round((high - low) * k);
    const X = (x) => (x - minX) * k, Y = (y) => (high - y) * k;
    const unit = r * k, thick = clamp(unit * 0.2, 9, 22), small = width < 480;
    const svg = canvas(width, height);
    const marked = (...names) => (names.includes(body) ? " culprit" : "");

    // the circle of crank angles
    const ring = unit * 1.22, at = (angle, radius) => { const a = (angle * Math.PI) / 180; return [X(0) + radius * Math.cos(a), Y(0) - radius * Math.sin(a)]; };
    const sector = (from, to, inner, outer) => {
      const turn = Math.min(to - from, 359.9), large = turn > 180 ? 1 : 0, p = (angle, radius) => at(angle, radius).map((value) => value.toFixed(2)).join(" ");
      return `M${p(from, outer)}A${outer} ${outer} 0 ${large} 0 ${p(from + turn, outer)}L${p(from + turn, inner)}A${inner} ${inner} 0 ${large} 1 ${p(from, inner)}Z`;
    };
    svg.append(s("circle", { class: "ring", cx: X(0), cy: Y(0), r: ring }));
    for (const [from, to] of ranges) svg.append(s("path", { class: "wedge", d: sector(from, to >= from ? to : to + 360, unit * 0.05, ring) }),
      s("path", { class: "arc", d: sector(from, to >= from ? to : to + 360, ring - 4, ring + 4) }));
    for (const angle of [0, 90, 180, 270]) {
      const [a, b] = [at(angle, ring - 4), at(angle, ring + 4)], [x, y] = at(angle, ring + (angle % 180 ? 13 : 18));
      svg.append(s("line", { class: "ring", x1: a[0], y1: a[1], x2: b[0], y2: b[1] }));
      if (angle) svg.append(s("text", { class: "tick", x, y: y + 4, "text-anchor": "middle" }, `${angle}°`));
    }
    const pointer = s("circle", { class: "pointer", r: 4 }), ray = s("line", { class: "ray" });

    // ground: the bearing at A and the guide
    const ground = s("g", { class: `ground${marked("frame")}` });
    const hatch = (x0, x1, y, down) => { const parts = [`M${x0} ${y}H${x1}`]; for (let x = x0 + 6; x <= x1; x += 9) parts.push(`M${x} ${y}l${-6} ${down * 7}`); return s("path", { d: parts.join("") }); };
    const shoe = unit * 0.3, inner = X(l - r) - unit * 0.62, outer = X(l + r) + unit * 0.58, line = Y(offset);
    ground.append(hatch(inner, outer, line - shoe - 3, -1), hatch(inner, outer, line + shoe + 3, 1),
      s("path", { class: "support", d: `M${X(0)} ${Y(0)}l${-unit * 0.24} ${unit * 0.42}h${unit * 0.48}Z` }), hatch(X(0) - unit * 0.36, X(0) + unit * 0.36, Y(0) + unit * 0.42, 1));
    svg.append(ground, s("line", { class: "centre", x1: X(0), x2: outer, y1: line, y2: line }));

    // bodies, each in its own coordinates; posed by transforms
    const capsule = (from, to, half) => s("rect", { x: from - half, y: -half, width: to - from + 2 * half, height: 2 * half, rx: half });
    const rodLength = l * k;
    const slider_ = s("g", { class: `body${marked("slider")}` }, s("rect", { x: -unit * 0.42, y: -shoe, width: unit * 0.84, height: 2 * shoe, rx: 5 }));
    const rod = s("g", { class: `body${marked("rod")}` }, capsule(0, rodLength, thick * 0.42));
    const crank_ = s("g", { class: `body${marked("crank")}` }, capsule(0, unit, thick * 0.6));
    const pins = {};
    const joint = (name) => {
      const loose = joints.includes(name), radius = thick * (loose ? 0.72 : 0.45);
      const group = s("g", { class: `joint${marked(`joint_${name.toLowerCase()}`)}` }, s("circle", { class: "bearing", r: radius }));
      const pin = s("circle", { class: "pin", r: loose ? radius * 0.55 : radius * 0.55 });
      group.append(pin);
      pins[name] = { pin, room: loose ? radius * 0.4 : 0 };
      return group;
    };
    const jointA = s("g", { class: "joint", transform: `translate(${X(0)} ${Y(0)})` }, s("circle", { class: "bearing", r: thick * 0.45 }), s("circle", { class: "pin", r: thick * 0.22 }));
    const jointB = joint("B"), jointC = joint("C");

    // sensors ride on the bodies
    let sick = null; // where the first sensor at fault is, in its body's coordinates
    const sensor = (parentBody, x, y, names) => {
      const fitted = names.filter((name) => channels.has(name));
      if (!fitted.length) return;
      const shows = fitted.filter((name) => name in guilty);
      const half = small ? 4 : 5.5;
      const fault = body === "instrument" && fitted.some((name) => faulty.has(name));
      if (fault) sick = { parent: parentBody, x, y };
      parentBody.append(s("g", { class: `sensor${shows.length ? " guilty" : ""}` },
        fault && s("circle", { class: "fault", cx: x, cy: y, r: half * 2.6 }),
        s("rect", { x: x - half, y: y - half, width: 2 * half, height: 2 * half, rx: 2 }),
        s("title", {}, `${fitted.map(words).join(", ")}${shows.length ? ` – shows it: ${shows.map(words).join(", ")}` : ""}`)));
    };
    sensor(crank_, unit * 0.24, 0, ["crank_a_transverse", "crank_a_axial"]);
    sensor(crank_, unit * 0.72, 0, ["crank_b_transverse", "crank_b_axial"]);
    sensor(rod, rodLength * 0.17, 0, ["rod_b_transverse", "rod_b_axial"]);
    sensor(rod, rodLength * 0.83, 0, ["rod_c_transverse", "rod_c_axial"]);
    sensor(slider_, unit * 0.27, 0, ["slider_vertical", "slider_horizontal"]);
    sensor(slider_, -unit * 0.27, 0, ["slider_position", "slider_velocity"]);
    const atA = s("g", { transform: `translate(${X(0)} ${Y(0)})` });
    sensor(atA, -unit * 0.34, 0, ["crank_angle", "crank_speed", "drive_torque"]);

    // the arrow of what is missing
    const arrows = s("g", { class: "arrows" });
    const straight = (length, lift) => s("path", { class: "arrow", d: `M${-length} ${lift}H${length}M${-length + 8} ${lift - 7}l-8 7l8 7M${length - 8} ${lift - 7}l8 7l-8 7` });
    const round = (radius) => {
      const p = (angle) => [radius * Math.cos(angle), -radius * Math.sin(angle)], [a, b] = [p(-0.7), p(2.3)], turn = 2.3;
      const tipAt = (fx, fy) => `M${b[0]} ${b[1]}L${b[0] + fx} ${b[1] + fy}`;
      const [tx, ty] = [Math.sin(turn), Math.cos(turn)]; // against the direction of travel, on screen
      return s("path", { class: "arrow", d: `M${a.join(" ")}A${radius} ${radius} 0 0 0 ${b.join(" ")}${tipAt(9 * tx + 6 * ty, 9 * ty - 6 * tx)}${tipAt(9 * tx - 6 * ty, 9 * ty + 6 * tx)}` });
    };
    const turns = /moment|torque|rotation|angle|tilt|theta/i.test(direction), across = /^\+?-?y$|vertical|transverse|normal|radial/i.test(direction);
    let place = null;
    if (body && body !== "instrument") {
      const own = s("g", {}), half = clamp(unit * 0.52, 26, 60);
      if (turns) own.append(round(body === "crank" ? unit * 0.62 : clamp(unit * 0.5, 24, 56)));
      else if (direction) own.append(s("g", { transform: across ? `translate(${/slider|joint_c/.test(body) ? unit * 0.54 : 0} 0) rotate(-90)` : "" }, straight(half, body === "slider" && !across ? shoe + 24 : body === "joint_c" && !across ? shoe + 24 : across ? 0 : -thick - 10)));
      else if (/^joint/.test(body)) own.append(s("circle", { class: "arrow", r: thick * 1.3 }));
      arrows.append(own);
      const along = /axial|transverse/.test(direction);
      place = (spot) => {
        const where = { crank: turns ? spot.A : spot.crank, rod: spot.rod, slider: spot.C, frame: [X(l + 0.1 * r), line + shoe + (turns || across ? 72 : 46 + thick + 10)], joint_b: spot.B, joint_c: spot.C }[body] ?? spot.A;
        own.setAttribute("transform", `translate(${where[0]} ${where[1]})${along ? ` rotate(${body === "crank" ? -spot.angle : -spot.tilt})` : ""}`);
        return where;
      };
    }
    const label = s("text", { class: "culprit-label", "text-anchor": "middle" }, body ? cut(caption, 30) : "");
    const halfLabel = Math.max(60, 4.7 * Math.min(caption.length, 30)); // pixels

    // the lens on the joint with play
    let lens = null;
    if (joints.length && clearance.joint) {
      const radius = unit * (small ? 0.44 : 0.4), cx = width - radius - 2, cy = radius + 4;
      const gap = radius * 0.26, pin = s("circle", { class: "pin", r: radius * 0.5 });
      const lines = s("path", { class: "leader" });
      const value = isNumber(clearance.after_m) ? ["clearance", "after_m"] : ["clearance", "before_m"];
      const limits = [clearance.low_m, clearance.high_m], bounded = limits.every(isNumber) && value[1] === "after_m";
      const shown = keyed(value, { scale: 1000 });
      svg.append(lines);
      lens = s("g", { transform: `translate(${cx} ${cy})` }, s("circle", { class: "lens", r: radius }), s("circle", { class: "bearing", r: radius * 0.5 + gap }), pin,
        s("text", { class: "lens-label", x: -radius - 10, y: 10 - radius, "text-anchor": "end" }, `joint ${joints.join(" and ")}`),
        isNumber(shown.value) && s("text", { class: "lens-label", x: -radius - 10, y: 28 - radius, "text-anchor": "end" }, "c = ",
          s("tspan", shown.attributes, bounded ? textWithin(shown.value, limits[0] * 1000, limits[1] * 1000) : text(shown.value, 3)), " mm"));
      lens.follow = (spot) => {
        const [jx, jy] = spot[joints[0]], far = Math.hypot(jx - cx, jy - cy), a = Math.atan2(jy - cy, jx - cx), spread = Math.acos(clamp((radius - thick) / far, -1, 1));
        lines.setAttribute("d", [1, -1].map((side) => { const b = a + side * spread; return `M${cx + radius * Math.cos(b)} ${cy + radius * Math.sin(b)}L${jx + thick * Math.cos(b)} ${jy + thick * Math.sin(b)}`; }).join(""));
        pin.setAttribute("cx", gap * Math.cos(spot.lean)); pin.setAttribute("cy", gap * Math.sin(spot.lean));
      };
    }
    const names = ["A", "B", "C"].map((name) => s("text", { class: "joint-name", "text-anchor": "middle" }, name));
    const bodies = [body === "crank" && turns ? "" : "crank", "rod", "slider"].map((name) => s("text", { class: `body-name${marked(name)}`, "text-anchor": "middle" }, name));
    svg.append(slider_, crank_, rod, jointA, jointB, jointC, atA, ray, pointer, arrows, ...names, ...(small ? [] : bodies), label);
    if (lens) svg.append(lens);

    pose = (angle) => {
      const a = (angle * Math.PI) / 180, bx = r * Math.cos(a), by = r * Math.sin(a);
      const cx = bx + Math.sqrt(Math.max(l * l - (by - offset) ** 2, 0)), tilt = Math.atan2(offset - by, cx - bx);
      const spot = { A: [X(0), Y(0)], B: [X(bx), Y(by)], C: [X(cx), Y(offset)], crank: [X(bx / 2), Y(by / 2)], rod: [X((bx + cx) / 2), Y((by + offset) / 2)], angle, tilt: (tilt * 180) / Math.PI, lean: -tilt + (Math.cos(a) > 0 ? 0 : Math.PI) };
      crank_.setAttribute("transform", `translate(${spot.A}) rotate(${-angle})`);
      rod.setAttribute("transform", `translate(${spot.B}) rotate(${-spot.tilt})`);
      slider_.setAttribute("transform", `translate(${spot.C})`);
      jointB.setAttribute("transform", `translate(${spot.B})`);
      jointC.setAttribute("transform", `translate(${spot.C})`);
      for (const { pin, room } of Object.values(pins)) { pin.setAttribute("cx", room * Math.cos(spot.lean)); pin.setAttribute("cy", room * Math.sin(spot.lean)); }
      const [px, py] = at(angle, ring);
      const [rx, ry] = at(angle, unit * 1.0 + thick * 0.8);
      for (const [name, value] of [["x1", rx], ["y1", ry], ["x2", px], ["y2", py]]) ray.setAttribute(name, value);
      pointer.setAttribute("cx", px); pointer.setAttribute("cy", py);
      const put = (element, [x, y]) => { element.setAttribute("x", x); element.setAttribute("y", y); };
      put(names[0], [spot.A[0] - unit * 0.2, spot.A[1] + unit * 0.24]);
      const away = a + (Math.sin(a) >= 0 ? 1.75 : -1.75), reach = thick * 0.75 + 11;
      put(names[1], [spot.B[0] + reach * Math.cos(away), spot.B[1] - reach * Math.sin(away) + 5]);
      put(names[2], [spot.C[0], spot.C[1] - thick * 1.02]);
      const side = Math.sin(a) >= 0 ? 1 : -1; // label on the open side of the link
      put(bodies[0], [spot.crank[0] - side * Math.sin(a) * thick * 2.4 - 4, spot.crank[1] - side * Math.cos(a) * thick * 1.5]);
      const share = body === "rod" ? 0.3 : 0.5; // clear of the arrow
      put(bodies[1], [spot.B[0] + share * (spot.C[0] - spot.B[0]) + thick * 0.5, spot.B[1] + share * (spot.C[1] - spot.B[1]) + (Math.sin(a) >= 0 ? -thick * 1.1 : thick * 1.8)]);
      put(bodies[2], [spot.C[0], spot.C[1] + (/slider|joint_c/.test(body) && !across && !turns ? -shoe - 18 : shoe + 24)]);
      const where = place?.(spot);
      if (where) {
        const lift = /slider|joint_c/.test(body) && !across && !turns ? -shoe - 48 : body === "frame" ? (turns ? -clamp(unit * 0.5, 24, 56) - 18 : thick - 14) : /^joint/.test(body) ? thick + 34 : body === "crank" && turns ? -unit * 0.86 : thick + 32;
        const rise = across ? (/frame|slider|joint_c/.test(body) ? -clamp(unit * 0.52, 26, 60) - 20 : clamp(unit * 0.52, 26, 60) + 14) : lift;
        put(label, [clamp(where[0] + (across && /slider|joint_c/.test(body) ? unit * 0.54 : 0), halfLabel, width - halfLabel), clamp(where[1] - rise, 14, height - 6)]);
      } else if (body === "instrument") {
        const [from, turn] = !sick ? [[spot.C[0] - unit * 0.2, spot.C[1]], 0] : sick.parent === crank_ ? [spot.A, angle] : sick.parent === rod ? [spot.B, spot.tilt] : [sick.parent === slider_ ? spot.C : spot.A, 0];
        const a = (turn * Math.PI) / 180, [dx, dy] = sick ? [sick.x, sick.y] : [0, 0];
        put(label, [clamp(from[0] + dx * Math.cos(a) + dy * Math.sin(a), Math.max(halfLabel, 70), width - Math.max(halfLabel, 70)), clamp(from[1] - dx * Math.sin(a) + dy * Math.cos(a) - (sick?.parent === rod || sick?.parent === crank_ ? 26 : shoe + 24), 14, height - 6)]);
      }
      svg.classList.toggle("showing", inRange(angle));
      lens?.follow(spot);
    };
    pose(crank.angle);
    return svg;
  }
}
