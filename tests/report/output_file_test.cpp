// Output files: permissions and previous contents of created and replaced files.
#include "base/output_file.h"

#include "base/json_reader.h"
#include "formats/documents/device_profile.h"
#include "formats/recording/crash_recovery.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_stream.h"
#include "plot/figure.h"
#include "tests/formats/support.h"

#include <sys/stat.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

unsigned mode_of(const std::string& file) {
  return static_cast<unsigned>(fs::status(file).permissions());
}

/// Sets the umask of the process for the duration of a test.
class Umask {
 public:
  explicit Umask(mode_t mask) : before_(umask(mask)) {}
  ~Umask() { umask(before_); }
  Umask(const Umask&) = delete;
  Umask& operator=(const Umask&) = delete;

 private:
  mode_t before_;
};

/// A function that writes a file, and the name of the file.
struct Maker {
  const char* name;
  void (*make)(const std::string& folder, const std::string& file);
};

void convert_to(const std::string& folder, const std::string& file) {
  write_recording(folder + "/source.h5", random_session(1, 10, {}));
  const auto source = open_source(folder + "/source.h5");
  const auto sink = create_sink(file, source->header(), source->columns(), {}, {.overwrite = true});
  copy(*source, *sink);
  sink->finish();
  fs::remove(folder + "/source.h5");
}

const Maker kMakers[] = {
    {"a.json",
     [](const std::string&, const std::string& file) {
       save_json({{"a", 1}}, file, true);
     }},
    {"a.h5",
     [](const std::string&, const std::string& file) {
       RecordingWriter writer(file, {}, {}, {.overwrite = true});
       writer.append(random_session(1, 10, {}));
       writer.finish();
     }},
    {"b.h5", convert_to},
    {"a.csv", convert_to},
    {"a.svg", [](const std::string&, const std::string& file) { save_figure({}, file, true); }},
};

TEST(OutputFile, KeepsThePermissionsOfTheFileThatItReplaces) {
  const Umask usual(022);
  const TempFolder folder;
  fs::permissions(folder.path(), fs::perms(0755));
  for (const Maker& maker : kMakers)
    for (const unsigned mode : {0600U, 0640U, 0666U}) {
      const std::string file = folder.write(maker.name, "older");
      fs::permissions(file, fs::perms(mode));
      maker.make(folder.path(), file);
      EXPECT_NE(read_bytes(file), "older") << maker.name;
      EXPECT_EQ(mode_of(file), mode) << maker.name;
    }
}

TEST(OutputFile, IsPrivateInAPrivateFolder) {
  const Umask usual(022);
  for (const auto& [of_folder, of_file] : {std::pair{0755U, 0644U}, std::pair{0700U, 0600U}, std::pair{0750U, 0644U}}) {
    const TempFolder folder;
    fs::permissions(folder.path(), fs::perms(of_folder));
    for (const Maker& maker : kMakers) {
      maker.make(folder.path(), folder / maker.name);
      EXPECT_EQ(mode_of(folder / maker.name), of_file) << maker.name;
    }
  }
}

TEST(OutputFile, KeepsItsTemporaryFilePrivate) {
  const Umask usual(022);
  const TempFolder folder;
  fs::permissions(folder.path(), fs::perms(0755));
  const std::string file = folder.write("a", "older");
  fs::permissions(file, fs::perms(0600));
  OutputFile output(file, true);
  output.create();
  EXPECT_EQ(mode_of(output.path()), 0600U);
  output.commit();
  EXPECT_EQ(read_bytes(file), "");
}

TEST(OutputFile, RecoversARecordingWithItsPermissions) {
  const Umask usual(022);
  const TempFolder folder;
  fs::permissions(folder.path(), fs::perms(0755));
  const std::string file = folder / "a.h5";
  {
    RecordingWriter writer(file, {}, {}, {});
    writer.append(random_session(1, 10, {}));
    writer.abandon();
  }
  fs::permissions(file, fs::perms(0600));
  recover_recording(file, folder / "copy.h5");
  EXPECT_EQ(mode_of(folder / "copy.h5"), 0600U);
  recover_recording(file);
  EXPECT_EQ(mode_of(file), 0600U);
  EXPECT_TRUE(RecordingReader(file).header().complete);
}

TEST(OutputFile, IsTestedBeforeTheWorkAndLeavesNothing) {
  const TempFolder folder;
  check_output(folder / "a.json", false);
  EXPECT_TRUE(fs::is_empty(folder.path()));
  expect_error([&] { check_output("/proc/a.json", false); }, Error::Kind::input, {"/proc/a.json", "cannot be created"});
  check_output_in_new_folders(folder / "none/nor/a.json", false);
  EXPECT_TRUE(fs::is_empty(folder.path()));
  const std::string file = folder.write("file", "");
  expect_error([&] { check_output_in_new_folders(file + "/none/a.json", false); }, Error::Kind::input,
               {file + "/none/a.json", "does not exist"});
  expect_error([&] { check_output_in_new_folders("/proc/none/a.json", false); }, Error::Kind::input,
               {"/proc/none/a.json", "cannot be created"});
  expect_error([&] { check_output_in_new_folders(file, false); }, Error::Kind::input, {"exists already"});
  expect_error([&] { check_output(folder / "none/a.json", false); }, Error::Kind::input, {"create it first"});
}

TEST(PrivateFolders, AreCreatedForThisUserAloneWhereTheyAreMissing) {
  const Umask usual(022);
  const TempFolder folder;
  fs::create_directory(folder / "shared");
  create_private_folders(folder / "shared/session/paths");
  EXPECT_EQ(mode_of(folder / "shared"), 0755U);
  EXPECT_EQ(mode_of(folder / "shared/session"), 0700U);
  EXPECT_EQ(mode_of(folder / "shared/session/paths"), 0700U);
  const std::string file = folder.write("file", "");
  expect_error([&] { create_private_folders(file + "/session"); }, Error::Kind::input, {"session: cannot be created"});
}

}  // namespace
}  // namespace haptrace
