// A notebook that shows the page in a frame: it has the data, reads images that the page cannot, and shares what is shown.

/** Name of the frame that a notebook's widget makes. */
const FRAME = "isolume-widget";

/** The other side, where there is one: `ask` for an answer, `tell` without one, `on` what it says. */
export const host = window.name === FRAME && window.parent !== window ? connect(window.parent) : null;

function connect(parent) {
  const waiting = new Map(), heard = new Map();
  let next = 0;
  addEventListener("message", (e) => {
    if (e.source !== parent || typeof e.data?.isolume !== "string") return;
    const { isolume: kind, id, error, ...body } = e.data;
    const asked = waiting.get(id);
    if (asked) {
      waiting.delete(id);
      if (error) asked.refuse(new Error(error));
      else asked.take(body);
    } else heard.get(kind)?.(body);
  });
  // The page is of the origin of the notebook, or of none where that is sandboxed: the receiver looks at its frame instead.
  const post = (message, moved = []) => parent.postMessage(message, "*", moved);
  return {
    tell: (kind, body) => post({ isolume: kind, ...body }),
    ask: (kind, body = {}, moved = []) => new Promise((take, refuse) => {
      waiting.set(++next, { take, refuse });
      post({ isolume: kind, id: next, ...body }, moved);
    }),
    on: (kind, act) => heard.set(kind, act),
  };
}
