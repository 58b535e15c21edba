import { background } from "./shared/background";
import { NoWebGL } from "./look/drawing/webgl2";
import { embedded } from "./look/embedded";
import { Look } from "./look/look";
import { alone } from "./look/data_source";
import * as api from "./shared/api";
import { banner, fail, reportUnhandled, say } from "./shared/notices";
import { Store } from "./shared/store";
import { SERVER_UNAVAILABLE } from "./shared/texts";
import { ProjectMenu } from "./project";
import { Tabs } from "./tabs";

const HEARTBEAT_MS = 3000;

declare global {
  interface Window {
    /** For tests and scripts. */
    omnimirror?: { look: Look; store: Store; tabs: Tabs };
  }
}

/** Report an unavailable server, and resume when it is available again. */
function watchServer(look: Look, tabs: Tabs): void {
  let wasUnavailable = false;
  const beat = async (): Promise<void> => {
    try {
      if (document.visibilityState === "visible") {
        const isAvailable = await api.isServerAvailable();
        banner(isAvailable ? null : SERVER_UNAVAILABLE, "server");
        if (isAvailable && (wasUnavailable || look.sensor.camera)) await look.resume().catch(fail); // an outage can be shorter than the interval
        if (isAvailable && wasUnavailable) {
          say("The server is available again.");
          tabs.show();
        }
        wasUnavailable = !isAvailable;
      }
    } finally {
      setTimeout(() => background(beat()), HEARTBEAT_MS);
    }
  };
  setTimeout(() => background(beat()), HEARTBEAT_MS);
}

/** Display the reason of a disabled button when it is pressed. */
function sayWhy(): void {
  const refuse = (e: Event): void => {
    const button = (e.target as Element).closest<HTMLElement>('button[aria-disabled="true"]');
    if (!button) return;
    e.stopImmediatePropagation();
    e.preventDefault();
    say(button.title);
  };
  document.addEventListener("click", refuse, true);
}

async function main(): Promise<void> {
  reportUnhandled(window);
  sayWhy();
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
  store.entered = () => banner(store.error, "address");
  store.entered();
  if (embedded()) return look.beginEmbedded();
  if (!alone) {
    new ProjectMenu(store, look);
    watchServer(look, tabs);
  }
  await look.begin().catch(fail);
}

background(main());
