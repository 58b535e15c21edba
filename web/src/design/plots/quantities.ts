/** Quantities plotted over the field angle, and their grouping. */
import type { QuantityInfo } from "../../shared/messages";
import { explained, symbolOf, unitWords } from "../labels";

/** Plot over the field angle: group, columns, decimals. */
interface Plot {
  group: string;
  columns: string[];
  places: number;
  /** Labels of several columns; all but the first are dashed. */
  title?: string;
  /** Largest value that the range includes, relative to the median; for quantities with poles. */
  reach?: number;
}

export const PLOTS: Plot[] = [
  { group: "Mapping", columns: ["h_px"], places: 1 },
  { group: "Mapping", columns: ["dh_domega_px_per_deg"], places: 3 },
  { group: "Viewpoint", columns: ["viewpoint_z_mm"], places: 2 },
  { group: "Area and aspect", columns: ["area_px2"], places: 2 },
  { group: "Area and aspect", columns: ["aspect"], places: 3 },
  { group: "Blur", columns: ["blur_t_px", "blur_s_px"], places: 2, title: "Blur in the image" },
  { group: "Blur", columns: ["blur_t_deg", "blur_s_deg"], places: 3, title: "Blur in angle" },
  { group: "Blur", columns: ["floored_area_deg2"], places: 3 },
  {
    group: "Object size",
    columns: ["plane_t_mm_per_px", "object_s_mm_per_px"],
    places: 3,
    title: "Object size on a plane",
    reach: 8,
  },
  {
    group: "Object size",
    columns: ["cylinder_t_mm_per_px", "object_s_mm_per_px"],
    places: 3,
    title: "Object size on a cylinder",
    reach: 8,
  },
];

/** Plot with texts from the vocabulary. */
export interface Chart {
  title: string;
  group: string;
  /** Block of numbers with its columns. */
  block: "curves" | "limits";
  unit: string;
  columns: { name: string; symbol: string; dashed: boolean }[];
  places: number;
  reach: number;
  hint: string;
}

/** Return the plots with the titles of their columns. */
export const chartsOf = (vocabulary: QuantityInfo[]): Chart[] =>
  PLOTS.map(({ group, columns, places, title, reach }) => {
    const quantities = columns.map((name) => vocabulary.find((q) => q.name === name)!);
    const named = quantities.map((q, i) => ({ name: q.name, symbol: symbolOf(q), dashed: i > 0 }));
    return {
      title: title ?? quantities[0].title,
      group,
      block: "curves",
      unit: unitWords(quantities[0].unit),
      columns: named,
      places,
      reach: reach ?? Infinity,
      hint: quantities.map(explained).join("; "),
    };
  });

/** Plot of a limited quantity; its column name can contain a spatial frequency. */
export const chartOf = (quantity: QuantityInfo, column: string): Chart => ({
  title: column.replace(quantity.name, quantity.title),
  group: "Limits",
  block: "limits",
  unit: unitWords(quantity.unit),
  columns: [{ name: column, symbol: symbolOf(quantity), dashed: false }],
  places: 3,
  reach: Infinity,
  hint: explained(quantity),
});
