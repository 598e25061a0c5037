// The worker that holds the page's WebSocket: it passes messages both ways and sends the page's sign of life.
import { PING_EVERY, SignOfLife } from "./life";
import type { FromWire, ToWire } from "./wire";

interface WorkerScope {
  onmessage: ((event: MessageEvent) => void) | null;
  postMessage(message: FromWire, transfer?: Transferable[]): void;
}

const scope = self as unknown as WorkerScope;
const life = new SignOfLife();
let socket: WebSocket | null = null;
// The first message must be the page's hello.
let greeted = false;
let pings = 0;

const now = (): number => performance.now() / 1000;

function drop(code: number, reason: string): void {
  const old = socket;
  socket = null;
  if (old === null) return;
  old.onopen = old.onmessage = old.onclose = null;
  old.close();
  scope.postMessage({ is: "closed", code, reason });
}

function open(url: string): void {
  drop(1006, "");
  const opened = new WebSocket(url);
  opened.binaryType = "arraybuffer";
  socket = opened;
  greeted = false;
  life.serverSpoke(now());
  opened.onopen = () => {
    life.serverSpoke(now());
    scope.postMessage({ is: "open" });
  };
  opened.onmessage = (event: MessageEvent) => {
    life.serverSpoke(now());
    const data = event.data as string | ArrayBuffer;
    scope.postMessage({ is: "message", data }, typeof data === "string" ? [] : [data]);
  };
  opened.onclose = (event: CloseEvent) => drop(event.code, event.reason);
}

scope.onmessage = (event: MessageEvent) => {
  const message = event.data as ToWire;
  life.mainRan(now());
  switch (message.do) {
    case "open":
      open(message.url);
      break;
    case "send":
      if (socket?.readyState !== WebSocket.OPEN) break;
      socket.send(message.data);
      greeted = true;
      break;
    case "here":
      break;
  }
};

setInterval(() => {
  // The answer comes from a message handler: unlike a timer, it runs on time in a hidden tab too.
  scope.postMessage({ is: "there?" });
  if (socket === null) return;
  if (life.serverLost(now())) {
    // A socket that says nothing is as good as closed; a new one shows which.
    drop(1006, "");
  } else if (greeted && socket.readyState === WebSocket.OPEN && life.pings(now())) {
    socket.send(JSON.stringify({ type: "ping", id: ++pings, sent: (performance.timeOrigin + performance.now()) / 1000 }));
  }
}, 1000 * PING_EVERY);
