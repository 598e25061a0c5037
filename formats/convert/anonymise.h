// Removal of personal data from recordings.
#pragma once

#include "formats/recording/recording_stream.h"

namespace haptrace {

struct AnonymiseReport {
  std::vector<std::string> dropped;  ///< fields that had content, such as "subject" or "config.record"
  std::vector<std::string> kept;     ///< fields that stay and may reveal a person or a time: "title", "created"
  std::uint64_t texts = 0;           ///< texts of events and warnings that were replaced
};

/// Removes personal data from a recording. It drops the subject, operator, notes, device serial number, clock readings
/// and all metadata. From the configuration it drops every text that is not the name of a choice (file names, titles,
/// serial numbers) and every value that users choose freely, numbers included. From the device name it drops the
/// options that neither name a choice nor describe a simulated device. It replaces texts of events and warnings that
/// are not made of haptrace's own words and numbers. The recording gets a new uuid. Title, time, and kind and model of
/// the device stay and are reported. Measured values stay: a movement can be as personal as handwriting.
class AnonymisedSource : public RecordingSource {
 public:
  [[nodiscard]] virtual const AnonymiseReport& report() const = 0;
};
std::unique_ptr<AnonymisedSource> anonymise(std::unique_ptr<RecordingSource> source);

}  // namespace haptrace
