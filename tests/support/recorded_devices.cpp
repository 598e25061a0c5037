// Lets test programs open recordings and paths as devices, like the command.
#include "recorder/recorded_devices.h"

namespace {

[[maybe_unused]] const bool kRegistered = (haptrace::use_recorded_devices(), true);

}  // namespace
