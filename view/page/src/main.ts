import { Client, takeToken } from "./client";
import { Model } from "./model";
import { Shell } from "./shell";
import { installTestHook } from "./test_hook";

const app = document.getElementById("app");
if (app !== null) {
  const model = new Model();
  const client = new Client(model, takeToken());
  const shell = new Shell(app, model, client);
  if (new URLSearchParams(location.search).has("test")) installTestHook(shell);
  client.start();
}
