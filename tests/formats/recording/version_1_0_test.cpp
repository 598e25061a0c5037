// Files of format 1.0 stay readable. The last program that wrote this format made the corpus. The expected values were
// read by h5py: rows, events, and XXH3 of the bytes of all columns in the order of the layout, with all parts of a
// recording together.
#include "tests/formats/support.h"

#include <cstdlib>
#include <fmt/format.h>

namespace haptrace {
namespace {

struct OldFile {
  const char* name;
  std::uint64_t rows;
  std::size_t events;
  std::uint64_t checksum;
};

void PrintTo(const OldFile& file, std::ostream* out) {
  *out << file.name;
}

class Version10 : public testing::TestWithParam<OldFile> {};

TEST_P(Version10, IsReadAsItWasWritten) {
  const TempFolder folder;
  const std::string name = GetParam().name;
  for (const auto& entry : std::filesystem::directory_iterator(HAPTRACE_VERSION_1_0)) {
    const std::string packed = entry.path().filename().string();
    if (packed.substr(0, packed.find('.')) != name) continue;
    const std::string command =
        fmt::format("gunzip -c '{}' > '{}'", entry.path().string(), folder / entry.path().stem().string());
    ASSERT_EQ(std::system(command.c_str()), 0);
  }
  const RecordingReader reader(folder / (name + ".h5"));
  EXPECT_EQ(reader.header().format_version, "1.0");
  ASSERT_EQ(reader.rows(), GetParam().rows);
  EXPECT_EQ(reader.events().size(), GetParam().events);
  EXPECT_TRUE(reader.clocks().empty());
  const std::vector<Sample> samples = reader.read(0, reader.rows());
  std::string bytes;
  for (const layout::Column& column : layout::columns())
    if (column.in(reader.columns())) bytes += bytes_of(column, samples);
  EXPECT_EQ(layout::checksum(std::as_bytes(std::span(bytes))), GetParam().checksum);
  for (const Finding& finding : check_recording(folder / (name + ".h5")))
    EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
}

INSTANTIATE_TEST_SUITE_P(
    Corpus, Version10,
    testing::Values(OldFile{"plain", 401, 2, 0xaaea971b2db896a4U}, OldFile{"rounded", 601, 2, 0x86e0209017b60ddcU},
                    OldFile{"packed", 601, 2, 0xeabbc0a171683e85U}, OldFile{"parts", 501, 2, 0x8751774ed3848435U},
                    OldFile{"played", 776, 3, 0xe0aefa5200aedbaaU}, OldFile{"guided", 762, 4, 0x44410b3388e51ec7U},
                    OldFile{"killed", 592, 12, 0xaecbe2ce3eafb4a6U}, OldFile{"old", 401, 2, 0xaaea971b2db896a4U}),
    [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace haptrace
