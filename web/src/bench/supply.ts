/** Requests of the bench: to the server, or to the page itself. */
import * as api from "../shared/api";
import { heldBy } from "../shared/dom";
import type {
  StandaloneBench,
  BenchSensor,
  BenchStart,
  DesignChange,
  FileRequest,
  ImportedFile,
  SliderRequest,
  SliderViolations,
} from "../shared/messages";
import { Answerer } from "./alone/answer";
import { AnswersAlone } from "./alone/answers";
import { Answers } from "./answers";
import type { Found } from "./found";

/** Data of a page without a server; null if there is a server. */
export const alone = heldBy<StandaloneBench>("bench-alone");
const answerer = alone && new Answerer(alone);

const WITH_THE_PROGRAM = "requires the installed program.";

export const benchStart = async (): Promise<BenchStart> => (alone ? alone.start : api.benchStart());

export async function bundled(name: string): Promise<BenchSensor> {
  if (!alone) return api.bundled(name);
  const found = alone.start.sensors.indexOf(name);
  if (found < 0)
    throw new api.Refused(
      `${name} requires a server; this page contains ${alone.start.sensors.join(", ")}.`,
    );
  return alone.sensors[found];
}

/** Change the type of a part, or the focus; a page without a server supports the focus only. */
export async function change(asked: DesignChange): Promise<BenchSensor> {
  if (!answerer) return api.change(asked);
  const focus =
    Math.round(1000 * answerer.bestFocus(asked.tables, asked.object_distance_mm)) / 1000; // 1 um, finer than the setting accuracy of lenses
  return {
    tables: { ...asked.tables, lens: { ...asked.tables.lens, focus_distance_mm: focus } },
    follows: false,
  };
}

/** Request the violation of requirements along all sliders; not available without a server. */
export const slides = async (asked: SliderRequest): Promise<SliderViolations | null> =>
  alone ? null : api.slides(asked);

export async function openFile(file: Blob, name: string): Promise<ImportedFile> {
  if (alone) throw new api.Refused(`Opening ${name} ${WITH_THE_PROGRAM}`);
  return api.openFile(file, name);
}

export async function download(asked: FileRequest): Promise<{ blob: Blob; name: string }> {
  if (alone) throw new api.Refused(`Downloading files of a design ${WITH_THE_PROGRAM}`);
  return api.download(asked);
}

/** Create the evaluator of designs. */
export const answers = (
  answered: (found: Found) => void,
  away: (isAway: boolean) => void,
): Answers | AnswersAlone =>
  answerer ? new AnswersAlone(answerer, answered) : new Answers(answered, away);
