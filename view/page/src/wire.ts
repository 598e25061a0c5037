// The connection as the page's main thread sees it. The socket lives in a worker (wire_worker.ts), so that the page's
// sign of life and the server's backpressure do not depend on drawing.

// From the main thread: open a socket, answer a question, send a message.
export type ToWire = { do: "open"; url: string } | { do: "here" } | { do: "send"; data: string | ArrayBuffer };
// To the main thread. "there?" asks whether the main thread runs.
export type FromWire = { is: "open" } | { is: "closed"; code: number; reason: string } | { is: "there?" } | { is: "message"; data: string | ArrayBuffer };

export interface WireEvents {
  open(): void;
  message(data: string | ArrayBuffer): void;
  closed(code: number, reason: string): void;
}

export class Wire {
  private readonly worker: Worker;
  private opened = false;

  constructor(events: WireEvents) {
    this.worker = new Worker("/wire.js");
    this.worker.onmessage = (event: MessageEvent) => {
      const message = event.data as FromWire;
      switch (message.is) {
        case "there?":
          this.post({ do: "here" });
          break;
        case "open":
          this.opened = true;
          events.open();
          break;
        case "closed":
          this.opened = false;
          events.closed(message.code, message.reason);
          break;
        case "message":
          events.message(message.data);
          break;
      }
    };
    this.worker.onerror = () => {
      this.opened = false;
      events.closed(1006, "");
    };
  }

  get ready(): boolean {
    return this.opened;
  }

  open(url: string): void {
    this.post({ do: "open", url });
  }

  send(data: string | ArrayBuffer): void {
    this.post({ do: "send", data });
  }

  private post(message: ToWire): void {
    this.worker.postMessage(message);
  }
}
