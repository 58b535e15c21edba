/** Requests of the Design tab: to the server, or to the page itself. */
import * as api from "../shared/api";
import { embeddedData } from "../shared/dom";
import type {
  StandaloneDesign,
  DesignSensor,
  DesignStart,
  DesignChange,
  FileRequest,
  ImportedFile,
  SliderRequest,
  SliderViolations,
} from "../shared/messages";
import { LocalEvaluator } from "./standalone/evaluator";
import { LocalEvaluationQueue } from "./standalone/evaluation_queue";
import { EvaluationSocket } from "./evaluation_socket";
import type { Evaluation } from "./evaluation";

/** Data of a page without a server; null if there is a server. */
export const alone = embeddedData<StandaloneDesign>("standalone-design");
const localEvaluator = alone && new LocalEvaluator(alone);

const WITH_THE_PROGRAM = "requires the installed program.";

export const designStart = async (): Promise<DesignStart> =>
  alone ? alone.start : api.designStart();

export async function bundled(name: string): Promise<DesignSensor> {
  if (!alone) return api.bundled(name);
  const result = alone.start.sensors.indexOf(name);
  if (result < 0)
    throw new api.RequestRejected(
      `${name} requires a server; this page contains ${alone.start.sensors.join(", ")}.`,
    );
  return alone.sensors[result];
}

/** Change the type of a part, or the focus; a page without a server supports the focus only. */
export async function change(request: DesignChange): Promise<DesignSensor> {
  if (!localEvaluator) return api.change(request);
  const focus =
    Math.round(1000 * localEvaluator.bestFocus(request.tables, request.object_distance_mm)) / 1000; // 1 um, finer than the setting accuracy of lenses
  return {
    tables: { ...request.tables, lens: { ...request.tables.lens, focus_distance_mm: focus } },
    follows_mapping: false,
  };
}

/** Request the violation of requirements along all sliders; not available without a server. */
export const feasibleRanges = async (request: SliderRequest): Promise<SliderViolations | null> =>
  alone ? null : api.feasibleRanges(request);

export async function openFile(file: Blob, name: string): Promise<ImportedFile> {
  if (alone) throw new api.RequestRejected(`Opening ${name} ${WITH_THE_PROGRAM}`);
  return api.openFile(file, name);
}

export async function download(request: FileRequest): Promise<{ blob: Blob; name: string }> {
  if (alone) throw new api.RequestRejected(`Downloading files of a design ${WITH_THE_PROGRAM}`);
  return api.download(request);
}

/** Create the evaluator of designs. */
export const evaluator = (
  onEvaluation: (result: Evaluation) => void,
  onAvailability: (isUnavailable: boolean) => void,
): EvaluationSocket | LocalEvaluationQueue =>
  localEvaluator
    ? new LocalEvaluationQueue(localEvaluator, onEvaluation)
    : new EvaluationSocket(onEvaluation, onAvailability);
