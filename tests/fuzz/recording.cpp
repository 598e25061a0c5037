// A recording: what plays it reads it, and what checks it checks it.
#include "formats/recording.h"

#include "formats/path_file.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file = fuzz::file_of(fuzz::text_of(data, size));
  fuzz::answer([&] {
    RecordingReader reader(file);
    fuzz::answer([&] { fuzz::require(reader.read(0, reader.rows()).size() == reader.rows()); });
    fuzz::answer([&] { (void)reader.events(); });
    reader.refresh();
  });
  fuzz::answer([&] { (void)check_recording(file); });
  fuzz::answer([&] { (void)load_path(file); });
  return 0;
}
