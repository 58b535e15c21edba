// Threads that sleep until there is work.
#pragma once

namespace omnimirror {

using Task = void (*)(void* context, int index);

// Call task(context, i) for i in [0, count), on the pool's threads and this one; returns when all are done.
// Where the pool is busy with another caller's work, this thread does its work alone.
void parallel_for(int count, Task task, void* context);

// How many threads work, the caller's among them.
void set_threads(int count);
int get_threads();

}  // namespace omnimirror
