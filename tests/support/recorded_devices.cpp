// Test programs open recordings and paths as devices, as the command does.
#include "recorder/recorded_devices.h"

namespace {

[[maybe_unused]] const bool kRegistered = (haptrace::use_recorded_devices(), true);

}  // namespace
