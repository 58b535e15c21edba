// Run by Node: a module of MicroPython and its tables, and what its functions answer.
// node in_micropython.mjs FOLDER-OF-MICROPYTHON MODULE.py TABLES.bin 'EXPRESSION'
import { readFileSync } from "node:fs";
import { basename } from "node:path";

const [folder, script, tables, expression] = process.argv.slice(2);
const { loadMicroPython } = await import(`${folder}/micropython.mjs`);
const board = await loadMicroPython({ heapsize: 262144 }); // bytes, as an OpenMV has to spare
for (const file of [script, tables]) board.FS.writeFile(`/${basename(file)}`, readFileSync(file));
board.runPython(`import sys\nsys.path.append("/")\nimport ${basename(script, ".py")} as view\nprint(${expression})`);
