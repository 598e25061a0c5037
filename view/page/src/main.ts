import { Client, takeToken } from "./client";
import { Model } from "./model";
import { Shell } from "./shell";
import { installTestHook } from "./test_hook";

const app = document.getElementById("app");
if (app !== null) {
  const model = new Model();
  const { token, test } = takeToken();
  const client = new Client(model, token);
  const shell = new Shell(app, model, client);
  if (test) installTestHook(shell);
  client.start();
}
