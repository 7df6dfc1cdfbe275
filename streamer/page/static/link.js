// The connection to the run: messages out, answers and pictures in; it connects again by itself.

const AGAIN_MS = 1000;

export class Link {
  // handlers: {picture(Float32Array), message(object), open(), closed(), refused()}
  constructor(handlers) {
    this.handlers = handlers;
    this.token = fromAddress() ?? sessionStorage.getItem("token");
    this.source = ownName();
    this.next = 1;
    this.waiting = new Map();
    this.socket = null;
    this.opened = false;
  }

  setToken(token) {
    this.token = token;
    sessionStorage.setItem("token", token);
  }

  get headers() {
    return this.token ? { authorization: `Bearer ${this.token}` } : {};
  }

  // The address of the run; throws where it refuses.
  async get(path) {
    const response = await fetch(path, { headers: this.headers });
    if (response.status === 401) this.handlers.refused();
    if (!response.ok) throw new Error(`${path}: ${response.status}`);
    return response.json();
  }

  connect() {
    const token = this.token ? `&token=${encodeURIComponent(this.token)}` : "";
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/targets?page&status=4${token}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { this.opened = true; this.handlers.open(); };
    socket.onclose = () => {
      this.opened = false;
      for (const answer of this.waiting.values()) answer({ state: "refused", reason: "the connection is lost" });
      this.waiting.clear();
      this.handlers.closed();
      setTimeout(() => this.connect(), AGAIN_MS);
    };
    socket.onmessage = ({ data }) => {
      if (data instanceof ArrayBuffer) return this.handlers.picture(new Float32Array(data));
      const message = JSON.parse(data);
      if (message.type !== "answer") return this.handlers.message(message);
      this.waiting.get(message.id)?.(message);
      this.waiting.delete(message.id);
    };
    this.socket = socket;
  }

  // Send a message; resolves to its answer.
  send(message) {
    if (!this.opened) return Promise.resolve({ state: "refused", reason: "not connected" });
    const number = this.next++;
    const id = `${this.source}-${number}`;
    this.socket.send(JSON.stringify({ ...message, id, source: this.source, sequence: number }));
    return new Promise((resolve) => this.waiting.set(id, resolve));
  }
}

// The name of this page. It keeps it when it is loaded again, and with it the operator's lease; a copy of its tab is
// another page, so the name is stored only while no page has it.
function ownName() {
  const name = sessionStorage.getItem("source") ?? `page ${crypto.getRandomValues(new Uint16Array(1))[0].toString(36)}`;
  sessionStorage.removeItem("source");
  addEventListener("pagehide", () => sessionStorage.setItem("source", name));
  addEventListener("pageshow", () => sessionStorage.removeItem("source"));
  return name;
}

// A token behind "#token=" is not sent to any server and not logged; it is taken out of the address.
function fromAddress() {
  const found = new URLSearchParams(location.hash.slice(1)).get("token");
  if (found) {
    sessionStorage.setItem("token", found);
    history.replaceState(null, "", location.pathname);
  }
  return found;
}
