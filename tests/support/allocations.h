// Counts what a piece of code allocates: the proof that a real-time function allocates nothing.
#pragma once

#include <cstddef>

namespace haptrace::test {

/// Calls of operator new in this thread since the program started.
std::size_t allocations() noexcept;

}  // namespace haptrace::test
