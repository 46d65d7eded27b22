// The WebSocket to the manager, opened again whenever it is lost.

const FIRST_RETRY_MS = 300;
const LAST_RETRY_MS = 3000;

export class Link {
  // `told` is called with every message, `changed` with "live" or "lost".
  constructor(told, changed) {
    this.told = told;
    this.changed = changed;
    this.retryMs = FIRST_RETRY_MS;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/live`);
    this.socket.onmessage = ({ data }) => {
      this.retryMs = FIRST_RETRY_MS;
      const message = JSON.parse(data);
      if (message.type === "hello") this.changed("live");
      this.told(message);
    };
    this.socket.onclose = () => {
      this.changed("lost");
      setTimeout(() => this.open(), this.retryMs);
      this.retryMs = Math.min(2 * this.retryMs, LAST_RETRY_MS);
    };
  }

  select(vehicle) {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    this.socket.send(JSON.stringify({ type: "select", vehicle }));
  }
}
