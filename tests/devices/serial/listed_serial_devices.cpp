#include "devices/registry.h"
#include "tests/devices/device_laws.h"

namespace haptrace::test {

std::vector<Listed> listed_devices() {
  const auto emulated = [](const std::string& spec) { return [spec] { return open_device(spec); }; };
  return {{"haply2diy", emulated("haply2diy:emulated=true"), true, true, false},
          {"haply2diy_held", emulated("haply2diy:emulated=true,hand=relaxed"), true, false, false},
          {"hapkit", emulated("hapkit:emulated=true"), true, true, false},
          {"hapkit_held", emulated("hapkit:emulated=true,hand=relaxed"), true, false, false}};
}

}  // namespace haptrace::test
