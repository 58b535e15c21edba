import { background } from "./shared/background";
import { fileOf } from "./look/feeds/feed";
import {
  identityIn,
  identityOf,
  keep,
  storeImage,
  stored,
  storedImage,
  sourceOf,
} from "./look/feeds/image_storage";
import type { Look } from "./look/look";
import { fromHash, toHash } from "./shared/address";
import * as api from "./shared/api";
import { byId, closeOutside, save } from "./shared/dom";
import { fail, say } from "./shared/notices";
import { checkReadable } from "./shared/media";
import { locals, parsed, put, sessions, load } from "./shared/storage";
import type { Store } from "./shared/store";

const KIND = "omnimirror project";
const VERSION = 1;
const ENDING = ".omnimirror";
const MAX_BYTES = 256 << 20; // maximum size of an embedded image
const DESIGN_TAB = "omnimirror-design";

/** Content of a project file: the state, and the image and sensor that it requires. */
interface Project {
  kind: typeof KIND;
  version: number;
  /** State that differs from the default, as in the address. */
  state: string;
  image: { name: string; type: string; data: string } | null;
  sensor: { name: string; optics?: "mirror" | "fisheye"; isMade?: boolean; text: string } | null;
  /** Design tab: design, history, pinned designs. */
  tab: string | null;
}

/** Project files: save the complete state, and restore it anywhere with identical pixels. */
export class ProjectMenu {
  private readonly menu = byId<HTMLDetailsElement>("project");
  private readonly file = byId<HTMLInputElement>("project-file");

  constructor(
    private readonly store: Store,
    private readonly look: Look,
  ) {
    byId("save-project").addEventListener("click", () => background(this.try(() => this.save())));
    byId("open-project").addEventListener("click", () => this.file.click());
    this.file.addEventListener("change", () => {
      const [file] = this.file.files ?? [];
      if (file) background(this.try(() => this.open(file)));
      this.file.value = "";
    });
    closeOutside(this.menu);
    look.sources.projects = (file) => this.try(() => this.open(file));
  }

  private async try(act: () => Promise<void>): Promise<void> {
    this.menu.open = false;
    await act().catch((e: unknown) => fail(e));
  }

  private async save(): Promise<void> {
    this.store.leaving(); // commit an edited number field whose change event has not fired yet
    const { state } = this.store;
    const image = await this.image();
    const sensor = state.sensor.startsWith("file:") ? await stored(state.sensor) : undefined;
    const project: Project = {
      kind: KIND,
      version: VERSION,
      state: toHash({ ...state, source: image?.source ?? state.source }),
      image: image && {
        name: image.name,
        type: image.blob.type,
        data: await base64(image.blob),
      },
      sensor: sensor
        ? {
            name: sensor.name,
            optics: sensor.optics,
            isMade: sensor.isMade,
            text: await sensor.blob.text(),
          }
        : null,
      tab: load(sessions, DESIGN_TAB) ?? load(locals, DESIGN_TAB),
    };
    const name = `${(image?.name ?? "project").replace(/\.\w+$/, "")}${ENDING}`;
    save(new Blob([JSON.stringify(project)], { type: "application/json" }), name);
    say(
      `${name} contains the view${image ? `, ${image.name}` : ""}${sensor ? ` and ${sensor.name}` : ""}`,
    );
  }

  /** Return the current image with its identity; null if there is none, or for the demo room. */
  private async image(): Promise<{ blob: Blob; name: string; source: string } | null> {
    const { feed } = this.look;
    const { source } = this.store.state;
    if (!feed || source === "room") return null;
    const identity = identityIn(source);
    const own = identity ? await storedImage(identity) : undefined;
    if (!own && feed.moves)
      throw new api.RequestRejected(
        `Projects contain images and video files; ${feed.name} is a live source. Save a snapshot, or open a file.`,
      );
    const blob = own?.blob ?? (await fileOf(feed)).image;
    if (blob.size > MAX_BYTES)
      throw new api.RequestRejected(
        `${feed.name} has ${(blob.size / 2 ** 20).toFixed(0)} MB; the maximum in a project is ${MAX_BYTES >> 20} MB. Copy the link instead, and share the file separately.`,
      );
    return {
      blob,
      name: own?.name ?? feed.name,
      source: own ? source : sourceOf(await identityOf(blob, feed.name)),
    };
  }

  private async open(file: File | Blob): Promise<void> {
    await checkReadable(file, file instanceof File ? file.name : "The project");
    const project = projectIn(await file.text());
    const { state } = fromHash(project.state);
    if (project.image) {
      const { name, type, data } = project.image;
      const blob = unpacked(data, type);
      await storeImage(await identityOf(blob, name), { blob, name });
      if (!(await storedImage(await identityOf(blob, name))))
        throw new api.RequestRejected(
          `This browser cannot store ${name}; private windows do not support projects.`,
        );
    }
    if (project.sensor) {
      const { name, optics, isMade, text } = project.sensor;
      const blob = new Blob([text]);
      const entry = await api.loadSensor(blob, name, optics);
      await keep(entry.id, { blob, name, optics, isMade });
      state.sensor = entry.id;
    }
    if (project.tab) put([sessions, locals], DESIGN_TAB, project.tab);
    this.store.leaving = () => {}; // the current tab must not overwrite the loaded one
    this.store.set(state);
    location.reload();
  }
}

/** Parse a project file. */
function projectIn(text: string): Project {
  const result = parsed(text) as Partial<Project> | null | undefined;
  if (result?.kind !== KIND || typeof result.state !== "string")
    throw new api.RequestRejected(
      `The file must be a project file (${ENDING}) written by Save project.`,
    );
  if (result.version !== VERSION)
    throw new api.RequestRejected(
      `The project file has version ${String(result.version)}; this version of omnimirror supports version ${VERSION}. Update omnimirror.`,
    );
  return { image: null, sensor: null, tab: null, ...result } as Project;
}

async function base64(blob: Blob): Promise<string> {
  const address = await new Promise<string>((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result as string);
    reader.onerror = () => reject(reader.error!);
    reader.readAsDataURL(blob);
  });
  return address.slice(address.indexOf(",") + 1);
}

const unpacked = (data: string, type: string): Blob =>
  new Blob([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], { type });
