// Tests in real time. A device that is silent for some tens of milliseconds is lost, and on a machine that is busy with
// other work a test's threads may have to wait for longer than that. Such a test waits for events and states no
// durations where it can; where it cannot, it calls in_real_time(), and may then be tried again.
#pragma once

#include <functional>

namespace haptrace::test {

/// Marks the running test as one in real time. If it fails, and a thread of this process had to wait for a processor
/// meanwhile, the program prints for how long and runs the test again, five times at most. On a machine that is not
/// busy the first failure counts.
void in_real_time();

/// Runs the tests of a program whose flags GoogleTest has not seen yet, and returns its exit code. A law (suites
/// All/...) that skips itself is a failure: its list of parameters says what it applies to. `around` calls what it is
/// given, for what has to be there while tests run.
int run_tests(int argc, char** argv, const std::function<int(const std::function<int()>&)>& around);
int run_tests(int argc, char** argv);

}  // namespace haptrace::test
