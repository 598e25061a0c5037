#include "base/types.h"

namespace haptrace {

const char* to_string(Phase phase) noexcept {
  switch (phase) {
    case Phase::idle:
      return "idle";
    case Phase::approach:
      return "approach";
    case Phase::run:
      return "run";
    case Phase::hold:
      return "hold";
    case Phase::release:
      return "release";
    case Phase::stopped:
      return "stopped";
  }
  return "unknown";
}

}  // namespace haptrace
