// Statistics of the contacts with virtual objects in a recording.
#pragma once

#include "formats/recording/recording.h"
#include "scene/scene_session.h"

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <vector>

namespace haptrace {

/// Returns the statistics of the contacts with every object of the recording's scene, in the scene's order; nothing if
/// the recording has no contacts. They agree with those of the session: a contact without a depth counts only for its
/// force. Reads the table of contacts in blocks, and calls `each` with every contact, in the order of their times.
std::vector<TouchFigures> touch_figures(const RecordingReader& reader,
                                        const std::function<void(const ContactSample&)>& each = {});

/// Returns [{"object", "times", "seconds", "max_force_n", "max_depth_m"}, ...].
nlohmann::json json_of(std::span<const TouchFigures> touches);

}  // namespace haptrace
