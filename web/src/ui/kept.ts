/** What the browser keeps, so that nothing is lost on reload: the last picture, and calibrations that were loaded. */

export interface Kept {
  blob: Blob;
  name: string;
  optics?: "mirror" | "fisheye";
}

const STORE = "kept";

function open(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open("omnimirror-studio", 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE);
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

async function run<T>(mode: IDBTransactionMode, act: (store: IDBObjectStore) => IDBRequest<T>): Promise<T | undefined> {
  try {
    const base = await open();
    const request = act(base.transaction(STORE, mode).objectStore(STORE));
    return await new Promise((resolve) => {
      request.onsuccess = () => resolve(request.result);
      request.onerror = () => resolve(undefined);
    });
  } catch {
    return undefined; // private windows keep nothing
  }
}

export const keep = (key: string, value: Kept): Promise<unknown> => run("readwrite", (store) => store.put(value, key));
export const kept = (key: string): Promise<Kept | undefined> => run("readonly", (store) => store.get(key) as IDBRequest<Kept>);
