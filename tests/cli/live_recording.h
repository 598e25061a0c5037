// Waits for the recording of a running session, so that no test depends on the speed of the machine.
#pragma once

#include "base/error.h"
#include "formats/recording/recording.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>

namespace haptrace::test {

/// Waits until `condition` holds for the recording as it is now; returns false if it does not hold within a minute.
template <class Condition>
bool wait_for_recording(const std::string& file, Condition condition) {
  for (int attempt = 0; attempt < 3000; ++attempt) {
    try {
      if (condition(RecordingReader(file))) return true;
    } catch (const Error&) {
      // The file does not exist yet, or it changed during the read.
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return false;
}

inline bool wait_for_rows(const std::string& file, std::uint64_t rows) {
  return wait_for_recording(file, [&](const RecordingReader& reader) { return reader.rows() >= rows; });
}

/// Waits until the newest sample is in this phase or a later one.
inline bool wait_for_phase(const std::string& file, Phase phase) {
  return wait_for_recording(file, [&](const RecordingReader& reader) {
    return reader.rows() > 0 && reader.read(reader.rows() - 1, 1).front().phase >= phase;
  });
}

inline bool wait_for_event(const std::string& file, EventCode code) {
  return wait_for_recording(file, [&](const RecordingReader& reader) {
    const auto events = reader.events();
    return std::any_of(events.begin(), events.end(),
                       [&](const StoredEvent& event) { return event.code == static_cast<std::int32_t>(code); });
  });
}

}  // namespace haptrace::test
