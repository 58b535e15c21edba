import { background } from "./shared/background";
import type { begin as beginDesign } from "./design/entry";
import type { DesignTab } from "./design/design_tab";
import type { Host as DesignHost } from "./design/host";
import type { begin as beginCalibrate } from "./calibrate/entry";
import type { Calibrate } from "./calibrate/calibrate";
import type { Host as CalibrateHost } from "./calibrate/host";
import type { Look } from "./look/look";
import { isUserError } from "./shared/api";
import { byId, embeddedData } from "./shared/dom";
import type { StandaloneDesign } from "./shared/messages";
import { banner, copy, report, say } from "./shared/notices";
import type { State } from "./shared/state";
import type { Store } from "./shared/store";
import { loadFailed } from "./shared/texts";

type LazyTab = "design" | "calibrate";

/** Tabs whose scripts are loaded on first use: element and title. */
const LAZY_TABS: Partial<Record<State["tab"], { place: LazyTab; title: string }>> = {
  design: { place: "design", title: "The Design tab" },
  calibrate: { place: "calibrate", title: "The calibration" },
};
const ELEMENT_IDS = { look: "look", design: "design", calibrate: "calibrate" } as const;
const MAIN_REGIONS = {
  look: "#stage",
  design: "#design .desk",
  calibrate: "#calibrate .desk",
} as const;

/** Interface of both scripts. */
interface Script {
  begin: typeof beginDesign & typeof beginCalibrate;
}

/** Load a script; null on failure. A page without a server contains that of the Design tab. */
async function loadScript(name: LazyTab): Promise<Script | null> {
  const embedded =
    name === "design" ? embeddedData<StandaloneDesign>("standalone-design")?.script : null;
  const own = embedded && URL.createObjectURL(new Blob([embedded], { type: "text/javascript" }));
  const address = own || (import.meta.env.DEV ? `/src/${name}/entry.ts` : `./${name}.js`);
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
  design: DesignTab | null = null;
  calibrate: Calibrate | null = null;
  private readonly fetching = new Set<LazyTab>();

  constructor(private readonly store: Store) {
    for (const button of document.querySelectorAll<HTMLButtonElement>("#tabs button"))
      button.addEventListener("click", () => store.set({ tab: button.value as State["tab"] }));
    document.querySelector(".skip")!.addEventListener("click", (e) => {
      e.preventDefault(); // the fragment contains the state
      document.querySelector<HTMLElement>(MAIN_REGIONS[store.state.tab])?.focus();
    });
    store.listen((s, changed) => {
      if (changed.has("tab")) this.show();
      if (changed.has("design")) this.design?.goTo(s.design);
      if (changed.has("errors")) this.design?.setErrorsFrom(s.errors);
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
    document.querySelector(".skip")!.setAttribute("href", `#${ELEMENT_IDS[tab]}`);
    for (const [name, place] of Object.entries(ELEMENT_IDS)) byId(place).hidden = name !== tab;
    const requested = LAZY_TABS[tab];
    if (requested && !this[requested.place] && !this.fetching.has(requested.place))
      background(this.fetch(tab, requested.place, requested.title));
  }

  private async fetch(tab: State["tab"], place: LazyTab, title: string): Promise<void> {
    this.fetching.add(place);
    try {
      const script = await loadScript(place);
      if (!script) return banner(loadFailed(title), place);
      banner(null, place);
      if (place === "design") this.design = await script.begin(this.designHost());
      else this.calibrate = await script.begin(this.calibrateHost());
      byId(`${place}-busy`).hidden = true;
    } catch (e) {
      this.clear(tab, place);
      if (!isUserError(e)) throw e;
      report(e, place);
    } finally {
      this.fetching.delete(place);
    }
  }

  /** Remove the elements of a tab that failed to load, so that it can be retried. */
  private clear(tab: State["tab"], name: LazyTab): void {
    byId(name).replaceChildren(byId(`${name}-busy`));
    for (const part of document.querySelectorAll(`header [data-tab="${tab}"]`)) part.remove();
  }

  private hostOf(
    place: LazyTab,
    tab: State["tab"],
  ): Pick<DesignHost, "place" | "header" | "isShown" | "say"> & { banner: typeof banner } {
    return {
      place: byId(place),
      header: document.querySelector("header .tools")!,
      isShown: () => this.store.state.tab === tab,
      banner,
      say,
    };
  }

  private designHost(): DesignHost {
    return {
      ...this.hostOf("design", "design"),
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
      lookThrough: (file, name, image, imageName) =>
        this.lookThrough(file, name, (look) => look.sources.openFile(image, imageName)),
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
