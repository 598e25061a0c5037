// What a guardian keeps, whatever it speaks to. A test program that is built with guardian_laws.cpp lists its ports.
#pragma once

#include "devices/guardian/guardian.h"

#include <functional>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

namespace haptrace::test {

/// A port whose other end is the test's.
class GuardedBench {
 public:
  virtual ~GuardedBench() = default;
  GuardedBench() = default;
  GuardedBench(const GuardedBench&) = delete;
  GuardedBench& operator=(const GuardedBench&) = delete;

  [[nodiscard]] virtual GuardedPort port() = 0;
  [[nodiscard]] virtual std::vector<std::uint8_t> heard() = 0;  ///< all that was said, ever
};

struct ListedPort {
  std::string name;
  std::function<std::unique_ptr<GuardedBench>()> open;
};

void PrintTo(const ListedPort& port, std::ostream* out);

/// To be defined by the test program.
std::vector<ListedPort> listed_ports();

}  // namespace haptrace::test
