// Opener and creator functions of the formats behind recording_stream.h. Private to formats.
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

/// Throws Error(input) if `options` are not empty. `file` is then not CSV but of the stated `format`.
void refuse_csv_options(const CsvOptions& options, const std::string& file, const char* format);

/// Number of rows that are read at once.
inline constexpr std::size_t kSourceBlock = 4096;

/// Returns a random uuid, for data that differ from the recording they came from.
std::string new_uuid();

/// Remedy for stamps that do not increase, for messages.
inline constexpr const char* kResampleRemedy = "haptrace convert --resample HZ leaves such samples out";

/// Throws Error(input) unless the times and ticks of a block increase. `before` is the last row of the previous block.
void check_order(std::span<const Sample> samples, std::optional<Sample>& before, const std::string& file);

}  // namespace haptrace
