#include "devices/registry.h"
#include "tests/devices/device_laws.h"

namespace haptrace::test {

std::vector<Listed> listed_devices() {
  const auto emulated = [](const std::string& spec) { return [spec] { return open_device(spec); }; };
  return {{"haply2diy", emulated("haply2diy:emulated=true")},
          {"haply2diy_held", emulated("haply2diy:emulated=true,hand=relaxed"), true, false},
          {"hapkit", emulated("hapkit:emulated=true")},
          {"hapkit_held", emulated("hapkit:emulated=true,hand=relaxed"), true, false}};
}

}  // namespace haptrace::test
