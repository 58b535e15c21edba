import { background } from "./shared/background";
import type { begin as beginBench } from "./bench/begin";
import type { Bench } from "./bench/bench";
import type { Host as BenchHost } from "./bench/host";
import type { begin as beginCalibrate } from "./calibrate/begin";
import type { Calibrate } from "./calibrate/calibrate";
import type { Host as CalibrateHost } from "./calibrate/host";
import type { Look } from "./look/look";
import { isForeseen } from "./shared/api";
import { byId, heldBy } from "./shared/dom";
import type { StandaloneBench } from "./shared/messages";
import { banner, copy, report, say } from "./shared/notices";
import type { State } from "./shared/state";
import type { Store } from "./shared/store";
import { unfetched } from "./shared/texts";

type Fetched = "bench" | "calibrate";

/** Tabs whose scripts are loaded on first use: element and title. */
const FETCHED: Partial<Record<State["tab"], { place: Fetched; title: string }>> = {
  design: { place: "bench", title: "The design bench" },
  calibrate: { place: "calibrate", title: "The calibration" },
};
const PLACES = { look: "look", design: "bench", calibrate: "calibrate" } as const;
const SHOWN = { look: "#stage", design: "#bench .desk", calibrate: "#calibrate .desk" } as const;

/** Interface of both scripts. */
interface Script {
  begin: typeof beginBench & typeof beginCalibrate;
}

/** Load a script; null on failure. A page without a server contains that of the bench. */
async function fetched(name: Fetched): Promise<Script | null> {
  const held = name === "bench" ? heldBy<StandaloneBench>("bench-alone")?.script : null;
  const own = held && URL.createObjectURL(new Blob([held], { type: "text/javascript" }));
  const address = own || (import.meta.env.DEV ? `/src/${name}/begin.ts` : `./${name}.js`);
  try {
    return (await import(/* @vite-ignore */ address)) as Script;
  } catch {
    return null;
  } finally {
    if (own) URL.revokeObjectURL(own);
  }
}

/** Tabs of the page; all but the first are loaded on first use. */
export class Tabs {
  look: Look | null = null;
  bench: Bench | null = null;
  calibrate: Calibrate | null = null;
  private readonly fetching = new Set<Fetched>();

  constructor(private readonly store: Store) {
    for (const button of document.querySelectorAll<HTMLButtonElement>("#tabs button"))
      button.addEventListener("click", () => store.set({ tab: button.value as State["tab"] }));
    document.querySelector(".skip")!.addEventListener("click", (e) => {
      e.preventDefault(); // the fragment contains the state
      document.querySelector<HTMLElement>(SHOWN[store.state.tab])?.focus();
    });
    store.listen((s, changed) => {
      if (changed.has("tab")) this.show();
      if (changed.has("design")) this.bench?.goTo(s.design);
      if (changed.has("errors")) this.bench?.tryErrors(s.errors);
    });
    this.show();
  }

  show(): void {
    const { tab } = this.store.state;
    document.body.dataset.tab = tab;
    for (const button of document.querySelectorAll<HTMLButtonElement>("#tabs button")) {
      if (button.value === tab) button.setAttribute("aria-current", "page");
      else button.removeAttribute("aria-current");
    }
    document.querySelector(".skip")!.setAttribute("href", `#${PLACES[tab]}`);
    for (const [name, place] of Object.entries(PLACES)) byId(place).hidden = name !== tab;
    const wanted = FETCHED[tab];
    if (wanted && !this[wanted.place] && !this.fetching.has(wanted.place))
      background(this.fetch(tab, wanted.place, wanted.title));
  }

  private async fetch(tab: State["tab"], place: Fetched, title: string): Promise<void> {
    this.fetching.add(place);
    try {
      const made = await fetched(place);
      if (!made) return banner(unfetched(title), place);
      banner(null, place);
      if (place === "bench") this.bench = await made.begin(this.benchHost());
      else this.calibrate = await made.begin(this.calibrateHost());
      byId(`${place}-busy`).hidden = true;
    } catch (e) {
      this.clear(tab, place);
      if (!isForeseen(e)) throw e;
      report(e, place);
    } finally {
      this.fetching.delete(place);
    }
  }

  /** Remove the elements of a tab that failed to load, so that it can be retried. */
  private clear(tab: State["tab"], name: Fetched): void {
    byId(name).replaceChildren(byId(`${name}-busy`));
    for (const part of document.querySelectorAll(`header [data-tab="${tab}"]`)) part.remove();
  }

  private hostOf(
    place: Fetched,
    tab: State["tab"],
  ): Pick<BenchHost, "place" | "header" | "isShown" | "say"> & { banner: typeof banner } {
    return {
      place: byId(place),
      header: document.querySelector("header .tools")!,
      isShown: () => this.store.state.tab === tab,
      banner,
      say,
    };
  }

  private benchHost(): BenchHost {
    return {
      ...this.hostOf("bench", "design"),
      address: () => this.store.state.design,
      setAddress: (design) => this.store.set({ design }),
      errors: () => this.store.state.errors,
      setErrors: (errors) => this.store.set({ errors }),
      beforeLeaving: (act) => (this.store.leaving = act),
      lookThrough: (file, name) =>
        this.lookThrough(file, name, (look) => look.sources.openRoom(false)),
    };
  }

  private calibrateHost(): CalibrateHost {
    return {
      ...this.hostOf("calibrate", "calibrate"),
      copy: (command) => background(copy(command, "Command")),
      lookThrough: (file, name, picture, pictureName) =>
        this.lookThrough(file, name, (look) => look.sources.openFile(picture, pictureName)),
    };
  }

  /** Use a camera created by another tab. */
  private async lookThrough(
    file: Blob,
    name: string,
    open: (look: Look) => Promise<void>,
  ): Promise<void> {
    if (!this.look)
      return say("The tab Look requires WebGL2, which this browser does not support.");
    this.store.set({ tab: "look", source: "" });
    await this.look.sensor.load(file, name, "mirror", true);
    await open(this.look);
  }
}
