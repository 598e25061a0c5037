// Counting of executed instructions.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace haptrace {

/// Counts the user-space instructions that `work` executes between consecutive calls of the mark that it receives, for
/// the first `intervals` intervals; each count may be some tens too high. Uses the processor's counter if the system
/// allows it. Otherwise single-steps a child process, which is exact but slow (a hundred thousand instructions per
/// second). Returns an empty vector if neither is allowed, if `work` makes too few marks, or if it takes more than a
/// few million instructions.
///
/// `work` may run in a copy of this process made by fork(). Its changes may then be lost, and it must not need another
/// thread. Between the marks it should do only the work to be counted. Threads: any, one call at a time.
std::vector<std::uint64_t> count_instructions(const std::function<void(const std::function<void()>& mark)>& work,
                                              std::size_t intervals = 1);

}  // namespace haptrace
