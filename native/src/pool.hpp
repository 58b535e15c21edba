// Thread pool; idle threads sleep.
#pragma once

namespace omnimirror {

using Task = void (*)(void* context, int index);

// Call task(context, i) for i in [0, count) on the threads of the pool and the calling thread; return when all are
// done.
//
// Tasks may throw: no further tasks are started, running ones are awaited, and the first exception is rethrown here. If
// the pool is busy with another caller, or if a task calls this function, the calling thread does all of its work
// alone.
void parallel_for(int count, Task task, void* context);

// The number of worker threads, including the calling one.
void set_threads(int count);
int get_threads();

}  // namespace omnimirror
