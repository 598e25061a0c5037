// Laws that a guardian obeys on every kind of port. A test program links guardian_laws.cpp and lists its ports.
#pragma once

#include "devices/guardian/guardian.h"

#include <functional>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

namespace haptrace::test {

/// A port with the test at its other end.
class GuardedBench {
 public:
  virtual ~GuardedBench() = default;
  GuardedBench() = default;
  GuardedBench(const GuardedBench&) = delete;
  GuardedBench& operator=(const GuardedBench&) = delete;

  [[nodiscard]] virtual GuardedPort port() = 0;
  [[nodiscard]] virtual std::vector<std::uint8_t> heard() = 0;  ///< all bytes received so far
};

struct ListedPort {
  std::string name;
  std::function<std::unique_ptr<GuardedBench>()> open;
};

void PrintTo(const ListedPort& port, std::ostream* out);

/// Returns the ports to test; the test program defines it.
std::vector<ListedPort> listed_ports();

}  // namespace haptrace::test
