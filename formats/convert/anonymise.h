// A recording without what names people and things.
#pragma once

#include "formats/recording/recording_stream.h"

namespace haptrace {

struct AnonymiseReport {
  std::vector<std::string> dropped;  ///< fields that had something in them, as in "subject", "config.record"
  std::vector<std::string> kept;     ///< fields that are left and may still tell who or when: "title", "created"
  std::uint64_t texts = 0;           ///< free texts of events that were dropped
};

/// Drops subject, operator, notes, device_serial and all metadata; from the configuration every text that is not the
/// name of a choice (file names, titles, serials) and what people choose themselves, number or not; from the device's
/// description its options, unless they name a choice or describe a simulated device; the texts of events, unless they
/// are haptrace's own words and numbers. Gives a new uuid. Title, time, kind and model of the device stay, and are
/// reported. Measured values stay: a movement can be as personal as a handwriting.
class AnonymisedSource : public RecordingSource {
 public:
  [[nodiscard]] virtual const AnonymiseReport& report() const = 0;
};
std::unique_ptr<AnonymisedSource> anonymise(std::unique_ptr<RecordingSource> source);

}  // namespace haptrace
