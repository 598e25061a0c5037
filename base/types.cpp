#include "base/types.h"

#include "base/enum_names.h"

namespace haptrace {

const char* to_string(Phase phase) noexcept {
  static constexpr EnumNames<Phase, 6> kPhases{"phase", {"idle", "approach", "run", "hold", "release", "stopped"}};
  return kPhases.name(phase);
}

}  // namespace haptrace
