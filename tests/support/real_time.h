// Support for tests in real time. A device that is silent for some tens of milliseconds counts as lost, and on a busy
// machine a test's threads may have to wait longer. Where possible, such a test waits for events instead of durations.
// Otherwise it calls in_real_time(), and the program may repeat it.
#pragma once

#include <functional>

namespace haptrace::test {

/// Marks the running test as one in real time. If it fails after a thread of this process had to wait for a processor,
/// the program prints the delay and repeats the test, with at most five attempts. On an idle machine the first failure
/// counts.
void in_real_time();

/// Initialises GoogleTest, runs the tests and returns the program's exit code. A law (suites All/...) that skips itself
/// is a failure, since its list of parameters defines where it applies. `around` calls its argument, which runs the
/// tests, and can create objects that live meanwhile.
int run_tests(int argc, char** argv, const std::function<int(const std::function<int()>&)>& around);
int run_tests(int argc, char** argv);

}  // namespace haptrace::test
