// One opener and one creator per format behind recording_stream.h. Private to formats.
#pragma once

#include "formats/recording/recording_stream.h"

namespace haptrace {

std::unique_ptr<RecordingSource> open_csv(const std::string& file, const SourceOptions& options);
std::unique_ptr<RecordingSource> open_jsonl(const std::string& file, const SourceOptions& options);
std::unique_ptr<RecordingSource> open_xdf(const std::string& file, const SourceOptions& options);

std::unique_ptr<RecordingSink> create_csv(const std::string& file, const RecordingHeader& header,
                                          const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                          const SinkOptions& options);
std::unique_ptr<RecordingSink> create_jsonl(const std::string& file, const RecordingHeader& header,
                                            const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                            const SinkOptions& options);

/// Throws Error(input) when a user said how a CSV file is to be read, and `file` is none but `format`.
void refuse_csv_options(const CsvOptions& options, const std::string& file, const char* format);

/// Rows that are read at once.
inline constexpr std::size_t kSourceBlock = 4096;

/// A random uuid, for data that are no longer those of the recording they came from.
std::string new_uuid();

/// What to do about stamps that do not increase.
inline constexpr const char* kResampleRemedy = "haptrace convert --resample HZ leaves such rows out";

/// Throws Error(input) unless the times and ticks of a block increase, `before` being the last row of the block before.
void check_order(std::span<const Sample> samples, std::optional<Sample>& before, const std::string& file);

}  // namespace haptrace
