// How many instructions a piece of work takes.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace haptrace {

/// Counts the instructions, in user space, that `work` executes from each call of the mark it is given to the next, to
/// some tens more; of the first `intervals` of these. By the processor's counter where the system allows it; else in a
/// child process that is single-stepped, a hundred thousand instructions a second, which is exact but slow. Empty where
/// neither is allowed, or when `work` marks less often or takes more than a few million instructions on the way.
///
/// `work` may run in a copy of this process, made by fork(): what it changes may be lost, it must not need another
/// thread, and it should be prepared so that between the marks it does no more than what is to be counted. Threads:
/// any, one call at a time.
std::vector<std::uint64_t> count_instructions(const std::function<void(const std::function<void()>& mark)>& work,
                                              std::size_t intervals = 1);

}  // namespace haptrace
