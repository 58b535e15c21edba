import { background } from "../../shared/background";
import { put } from "../../shared/dom";
import { alone } from "../data_source";
import { embedded } from "../embedded";
import type { Renderer } from "./renderer";
import { WebGL2Renderer } from "./webgl2";
import type { begin } from "./webgpu";

const SCRIPT = import.meta.env.DEV ? "/src/look/drawing/webgpu.ts" : "./webgpu.js";

/**
 * Renderer of the views: WebGL2 from the start, WebGPU as soon as its adapter and script are available, and WebGL2 again
 * if WebGPU fails. The parameter `renderer` of the address selects one: `webgl2`, or `webgpu` also with a software
 * adapter, which otherwise is not used.
 */
export class Drawing {
  renderer: Renderer;
  /** Resolves when the renderer is selected, for tests. */
  readonly selected: Promise<void>;

  /** `emptied` is called when the renderer has lost its images, `replaced` before when its canvas is another. */
  constructor(
    private readonly place: HTMLElement,
    private readonly emptied: () => void,
    private readonly replaced: () => void,
  ) {
    this.renderer = this.webgl2();
    this.show();
    const choice = new URLSearchParams(location.search).get("renderer");
    const canUpgrade = choice !== "webgl2" && !alone && !embedded();
    this.selected = canUpgrade ? this.upgrade(choice === "webgpu") : Promise.resolve();
    background(this.selected);
  }

  private webgl2(): Renderer {
    return new WebGL2Renderer(document.createElement("canvas"), this.emptied);
  }

  /** Draw with WebGPU if it is available. */
  private async upgrade(allowsSoftware: boolean): Promise<void> {
    let renderer: Renderer | null = null;
    let hasFailed = false;
    const fail = (): void => {
      const isUsed = renderer !== null && !hasFailed;
      hasFailed = true;
      if (isUsed) this.use(this.webgl2());
    };
    try {
      const adapter = await navigator.gpu?.requestAdapter({ powerPreference: "high-performance" });
      if (!adapter || (adapter.info.isFallbackAdapter && !allowsSoftware)) return;
      const script = (await import(/* @vite-ignore */ SCRIPT)) as { begin: typeof begin };
      const prepared = await script.begin(adapter, document.createElement("canvas"), fail);
      if (hasFailed) return prepared.release();
      this.use((renderer = prepared));
    } catch {
      // WebGL2 draws already; WebGPU is an optimisation.
    }
  }

  private use(renderer: Renderer): void {
    const before = this.renderer;
    this.replaced();
    this.renderer = renderer;
    this.show();
    before.release();
    this.emptied();
  }

  private show(): void {
    this.place.replaceChildren(this.renderer.canvas);
    put("renderer", `The view is drawn with ${this.renderer.name}.`);
  }
}
