#include "recorder/recorded_devices.h"

#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "recorder/replay_device.h"

namespace haptrace {

void use_recorded_devices() {
  add_device_backend(replay_backend());
  set_sim_path_reader([](const std::string& file) { return load_path(file); });
}

}  // namespace haptrace
