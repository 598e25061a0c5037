// Writes the smallest possible recordings for the corpus: a finished one, one with every column, one whose writer died,
// a first part, a packed one and a rounded one.
//   fuzz_make_recordings FOLDER
#include "formats/recording/recording.h"

#include <cstdio>

using namespace haptrace;

namespace {

constexpr std::size_t kRows = 4;

RecordingWriter write(const std::string& file, const RecordingColumns& columns, const Storage& storage = {},
                      bool in_parts = false) {
  RecordingHeader header;
  header.uuid = "00000000-0000-4000-8000-000000000000";
  header.created = "2026-01-01T00:00:00Z";
  header.software = "haptrace";
  header.config = {{"rate_hz", 1000}};
  header.max_force_n = 8;
  header.meta = {{"group", "a"}};
  RecordingWriter::Options options{.overwrite = true, .storage = storage, .in_parts = in_parts};
  options.storage.rows_per_chunk = kRows;
  RecordingWriter writer(file, header, columns, options);
  std::vector<Sample> samples(kRows);
  for (std::size_t i = 0; i < kRows; ++i) {
    samples[i].tick = i;
    samples[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    samples[i].position = Vec3(0.01, 0.02, 0.03);
    samples[i].phase = Phase::run;
  }
  writer.append(samples);
  writer.append(StoredEvent{0.002, 50, "mark"});
  return writer;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
    return 2;
  }
  const std::string folder = std::string(argv[1]) + "/";
  write(folder + "finished.h5", {}).finish();
  write(folder + "every_column.h5",
        {.orientation = true, .torque = true, .force_measured = true, .reference = true, .guidance = true})
      .finish();
  write(folder + "abandoned.h5", {}).abandon();
  write(folder + "part.h5", {}, {}, true).finish();
  write(folder + "packed.h5", {}, {.deflate = 9}).finish();
  write(folder + "rounded.h5", {}, {.precision = {.position = 1e-6, .velocity = 1e-3, .force = 1e-3}}).finish();
  return 0;
}
