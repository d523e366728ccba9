// The widget of a notebook: the page in a frame, the data of the model handed to it, and what is shown kept the same on both sides.

const TRAITS = ["isovalue", "env", "rotate", "albedo", "colormap", "exposure", "camera"];
// Between two messages of what changes under the hand, in milliseconds.
const PAUSE = 60;

/** The model's traits as the page takes them. */
function stateOf(model) {
  const exposure = model.get("exposure");
  return {
    isovalue: model.get("isovalue"), env: model.get("env"), rotation: model.get("rotate"), albedo: model.get("albedo"),
    colormap: model.get("colormap"), camera: model.get("camera"), autoExposure: exposure === null, ...(exposure === null ? {} : { exposure }),
  };
}

/** What the page shows as the model's traits. */
function traitsOf(state) {
  return {
    isovalue: state.isovalue, env: state.env, rotate: state.rotation, albedo: state.albedo, colormap: state.colormap,
    exposure: state.autoExposure ? null : state.exposure, camera: state.camera,
  };
}

const bytesOf = (view) => new Uint8Array(view.buffer ?? view, view.byteOffset ?? 0, view.byteLength);

function payloadOf(model) {
  const pieces = model.get("_payload").map(bytesOf);
  const all = new Uint8Array(pieces.reduce((sum, piece) => sum + piece.length, 0));
  let at = 0;
  for (const piece of pieces) {
    all.set(piece, at);
    at += piece.length;
  }
  return all.buffer;
}

function imageOf(content, buffer) {
  const bytes = bytesOf(buffer).slice();
  return { name: content.name, width: content.width, height: content.height, rgb: new Float32Array(bytes.buffer) };
}

function render({ model, el }) {
  const frame = document.createElement("iframe");
  // The page sees by this name that it is in a widget.
  frame.name = "isolume-widget";
  frame.title = `isolume: ${JSON.parse(model.get("_header")).name}`;
  frame.style.cssText = `display: block; width: 100%; height: ${model.get("_height")}px; border: 0;`;
  frame.srcdoc = model.get("_page");
  const names = new Set(JSON.parse(model.get("_header")).probes.map((probe) => probe.name));
  let isReady = false, isTaking = false, due = null;

  const post = (message, moved = []) => frame.contentWindow?.postMessage(message, "*", moved);
  const update = () => isReady && post({ isolume: "update", state: stateOf(model) });
  const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

  /** The page has changed: so does the model, not more often than it can be told. */
  function take(state) {
    const wasDue = due !== null;
    due = state;
    if (wasDue) return;
    setTimeout(() => {
      const traits = traitsOf(due);
      due = null;
      if (!names.has(traits.env)) {
        names.add(traits.env);
        model.send({ kind: "added", name: traits.env });
      }
      isTaking = true;
      for (const name of TRAITS) if (!same(model.get(name), traits[name])) model.set(name, traits[name]);
      isTaking = false;
      model.save_changes();
    }, PAUSE);
  }

  function still(reason) {
    const url = URL.createObjectURL(new Blob([bytesOf(model.get("_still"))], { type: "image/png" }));
    const image = Object.assign(document.createElement("img"), { src: url, alt: "the surface, as a still" });
    const why = Object.assign(document.createElement("p"), { textContent: `This is a still: ${reason}` });
    frame.replaceWith(image);
    image.after(why);
  }

  function heard(e) {
    if (e.source !== frame.contentWindow || typeof e.data?.isolume !== "string") return;
    const { isolume: kind, id } = e.data;
    if (kind === "package") {
      const payload = payloadOf(model);
      post({ isolume: "answer", id, header: JSON.parse(model.get("_header")), payload }, [payload]);
    } else if (kind === "read") {
      model.send({ kind: "read", id, name: e.data.name }, undefined, [e.data.bytes]);
    } else if (kind === "state") {
      if (isReady) take(e.data.state);
    } else if (kind === "ready") {
      isReady = true;
      update();
    } else if (kind === "failed") {
      model.send({ kind: "failed", reason: e.data.reason });
      still(e.data.reason);
    }
  }

  function custom(content, buffers) {
    if (content.kind === "answer") {
      if (content.error) return post({ isolume: "answer", id: content.id, error: content.error });
      names.add(content.name);
      post({ isolume: "answer", id: content.id, ...imageOf(content, buffers[0]) });
    } else if (content.kind === "probe") {
      names.add(content.name);
      post({ isolume: "probe", ...imageOf(content, buffers[0]) });
    }
  }

  const changed = () => { if (!isTaking) update(); };
  addEventListener("message", heard);
  model.on("msg:custom", custom);
  TRAITS.forEach((name) => model.on(`change:${name}`, changed));
  el.append(frame);
  return () => {
    removeEventListener("message", heard);
    model.off("msg:custom", custom);
    TRAITS.forEach((name) => model.off(`change:${name}`, changed));
  };
}

export default { render };
