import * as api from "./api";
import { NoWebGL } from "./gl/renderer";
import { Look } from "./look";
import { Store } from "./state";
import { Tabs } from "./tabs";
import { banner, say } from "./ui/dom";

const HEARTBEAT_MS = 3000;
const AWAY = "The studio's server does not answer. What is shown stays; it goes on when the server is back.";

declare global {
  interface Window {
    /** For tests, and for whoever scripts the page. */
    omnimirror?: { look: Look; store: Store; tabs: Tabs };
  }
}

/** Tell when the server goes, and go on when it is back. */
function watchServer(look: Look): void {
  let isAway = false;
  const beat = async (): Promise<void> => {
    if (document.visibilityState === "visible") {
      const there = await api.isThere();
      if (!there) banner(AWAY);
      else if (isAway) {
        banner(null);
        say("The server is back.");
        await look.sensor.fetch();
      }
      isAway = !there;
    }
    setTimeout(() => void beat(), HEARTBEAT_MS);
  };
  setTimeout(() => void beat(), HEARTBEAT_MS);
}

async function main(): Promise<void> {
  const store = new Store();
  const tabs = new Tabs(store);
  let look: Look;
  try {
    look = tabs.look = new Look(store);
  } catch (e) {
    if (!(e instanceof NoWebGL)) throw e;
    return banner(e.message);
  }
  window.omnimirror = { look, store, tabs };
  if (api.embedded()) return look.beginEmbedded();
  watchServer(look);
  await look.begin().catch((e: unknown) => look.fail(e));
}

void main();
