import type { begin } from "./bench/begin";
import type { Bench } from "./bench/bench";
import type { Host } from "./bench/host";
import type { Look } from "./look/look";
import { byId } from "./shared/dom";
import { banner, say } from "./shared/notices";
import type { State } from "./shared/state";
import type { Store } from "./shared/store";
import { UNFETCHED, WENT_WRONG } from "./shared/texts";

const BENCH = import.meta.env.DEV ? "/src/bench/begin.ts" : "./bench.js";

/** The two halves of the page; the bench is fetched when it is wanted first. */
export class Tabs {
  look: Look | null = null;
  bench: Bench | null = null;
  private isFetching = false;

  constructor(private readonly store: Store) {
    for (const button of document.querySelectorAll<HTMLButtonElement>("#tabs button"))
      button.addEventListener("click", () => store.set({ tab: button.value as State["tab"] }));
    document.querySelector(".skip")!.addEventListener("click", (e) => {
      e.preventDefault(); // the address is that of what is seen
      document.querySelector<HTMLElement>(store.state.tab === "look" ? "#stage" : "#bench .desk")?.focus();
    });
    store.listen((s, changed) => {
      if (changed.has("tab")) this.show();
      if (changed.has("design")) this.bench?.goTo(s.design);
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
    document.querySelector(".skip")!.setAttribute("href", tab === "look" ? "#look" : "#bench");
    byId("look").hidden = tab !== "look";
    byId("bench").hidden = tab !== "design";
    if (tab === "design" && !this.bench && !this.isFetching) void this.fetch();
  }

  private async fetch(): Promise<void> {
    this.isFetching = true;
    try {
      const made = await (import(/* @vite-ignore */ BENCH) as Promise<{ begin: typeof begin }>).catch(() => null);
      if (!made) return banner(UNFETCHED, "bench");
      banner(null, "bench");
      this.bench = await made.begin(this.host());
      byId("bench-busy").hidden = true;
    } catch (e) {
      this.clear();
      const isSaid = e instanceof Error && (e.name === "Refused" || e.name === "Away");
      banner(isSaid ? e.message : WENT_WRONG, "bench");
      if (!isSaid) throw e;
    } finally {
      this.isFetching = false;
    }
  }

  /** Leave nothing of a bench that could not be made: the next one begins in its place. */
  private clear(): void {
    const [place, busy] = [byId("bench"), byId("bench-busy")];
    place.replaceChildren(busy);
    for (const part of document.querySelectorAll('header [data-tab="design"]')) part.remove();
  }

  private host(): Host {
    return {
      place: byId("bench"),
      header: document.querySelector("header .tools")!,
      isShown: () => this.store.state.tab === "design",
      address: () => this.store.state.design,
      setAddress: (design) => this.store.set({ design }),
      beforeLeaving: (act) => (this.store.leaving = act),
      banner,
      say,
      lookThrough: (file, name) => this.lookThrough(file, name),
    };
  }

  /** Look through a design, at the picture of a room that it takes. */
  private async lookThrough(file: Blob, name: string): Promise<void> {
    if (!this.look) return say("Looking needs WebGL2, which this browser does not offer.");
    this.store.set({ tab: "look", source: "" });
    await this.look.sensor.load(file, name, "mirror", true);
    await this.look.sources.openRoom(false);
  }
}
