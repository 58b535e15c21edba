/** Rectangle on the stage, px. */
export interface Cell {
  left: number;
  top: number;
  width: number;
  height: number;
}

const WIDE = 1.9; // aspect ratio above which a view gets its own row
const MAX_WIDE = 0.6; // height of all such rows together, relative to the stage
const GAP = 6; // px

/** Return the largest centred rectangle with a given aspect ratio; null uses the complete area. */
export function within(aspect: number | null, { left, top, width, height }: Cell): Cell {
  if (aspect === null) return { left, top, width, height };
  const w = Math.min(width, height * aspect);
  return {
    left: left + (width - w) / 2,
    top: top + (height - w / aspect) / 2,
    width: w,
    height: w / aspect,
  };
}

/** Arrange several views with given aspect ratios (null: any) such that the sum of their sizes (square roots of the areas) is maximal. */
export function arranged(
  aspects: readonly (number | null)[],
  width: number,
  height: number,
): Cell[] {
  const worth = (cells: Cell[]): number =>
    cells.reduce((sum, c) => sum + Math.sqrt(c.width * c.height), 0);
  const all = [true, false].flatMap((isAlone) =>
    aspects.map((_, i) => inRows(rowsOf(aspects, i + 1, isAlone), width, height)),
  );
  return all.reduce((best, cells) => (worth(cells) > worth(best) * 1.001 ? cells : best));
}

const isWide = (aspect: number | null): boolean => aspect !== null && aspect > WIDE;

/** Arrange views in rows of a given maximum length, wide views optionally in their own rows. */
function rowsOf(
  aspects: readonly (number | null)[],
  maximum: number,
  isAlone: boolean,
): (number | null)[][] {
  const rows: (number | null)[][] = [];
  for (const aspect of aspects) {
    const last = rows.at(-1);
    if (!last || last.length >= maximum || (isAlone && (isWide(aspect) || isWide(last[0]))))
      rows.push([aspect]);
    else last.push(aspect);
  }
  return rows;
}

function inRows(rows: (number | null)[][], width: number, height: number): Cell[] {
  const room = height - GAP * (rows.length - 1);
  const isLow = (row: readonly (number | null)[]): boolean => row.length === 1 && isWide(row[0]);
  const wide = rows.filter(isLow);
  const additional = rows.length - wide.length;
  const request = wide.reduce((sum, [aspect]) => sum + width / aspect!, 0);
  const less = Math.min(1, ((additional ? MAX_WIDE : 1) * room) / (request || 1));
  const rest = additional ? (room - less * request) / additional : 0;
  let top = additional ? 0 : (room - less * request) / 2;
  return rows.flatMap((row) => {
    const high = isLow(row) ? (less * width) / row[0]! : rest;
    const side = (width - GAP * (row.length - 1)) / row.length;
    const cells = row.map((aspect, i) =>
      within(aspect, { left: i * (side + GAP), top, width: side, height: high }),
    );
    top += high + GAP;
    return cells;
  });
}
