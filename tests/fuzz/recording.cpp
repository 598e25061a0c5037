// Fuzz target: a recording, opened by its reader, by the check and as a path.
#include "formats/recording/recording.h"

#include "formats/path/path_file.h"
#include "formats/recording/recording_summary.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file = fuzz::file_of(fuzz::text_of(data, size));
  fuzz::answer([&] {
    RecordingReader reader(file);
    fuzz::answer([&] { fuzz::require(reader.read(0, reader.rows()).size() == reader.rows()); });
    fuzz::answer([&] { (void)reader.events(); });
    fuzz::answer([&] { (void)reader.overview(); });
    fuzz::answer([&] { (void)reader.row_at(2'000'000); });
    reader.refresh();
  });
  fuzz::answer([&] { (void)check_recording(file); });
  fuzz::answer([&] { (void)load_path(file); });
  return 0;
}
