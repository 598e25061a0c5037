// Recordings that would make haptrace read other files: external links, external storage and virtual datasets.
#include "formats/path/path_file.h"
#include "formats/recording/crash_recovery.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_stream.h"
#include "tests/formats/support.h"

#include <gmock/gmock.h>
#include <hdf5.h>
#include <sys/stat.h>

namespace haptrace {
namespace {

constexpr hsize_t kRowsThere = 100;

/// One kind of reference from a recording to another file.
struct WayOut {
  const char* name;
  const char* where;  ///< Location in the finding of check_recording.
  const char* why;
  /// Puts the reference into the open recording. `secret` holds rows of doubles, `other` is a recording.
  void (*put)(hid_t file, const std::string& secret, const std::string& other);
};

void replace_position(hid_t file, hid_t creation) {
  const hsize_t rows[] = {kRowsThere, 3};
  H5Ldelete(file, "/samples/position", H5P_DEFAULT);
  const hid_t space = H5Screate_simple(2, rows, nullptr);
  const hid_t dataset =
      H5Dcreate2(file, "/samples/position", H5T_IEEE_F64LE, space, H5P_DEFAULT, creation, H5P_DEFAULT);
  H5Dclose(dataset);
  H5Sclose(space);
  H5Pclose(creation);
}

void link_dataset(hid_t file, const std::string&, const std::string& other) {
  H5Ldelete(file, "/samples/position", H5P_DEFAULT);
  H5Lcreate_external(other.c_str(), "/samples/position", file, "/samples/position", H5P_DEFAULT, H5P_DEFAULT);
}

void link_group(hid_t file, const std::string&, const std::string& other) {
  H5Ldelete(file, "/samples", H5P_DEFAULT);
  H5Lcreate_external(other.c_str(), "/samples", file, "/samples", H5P_DEFAULT, H5P_DEFAULT);
}

void link_metadata(hid_t file, const std::string&, const std::string& other) {
  H5Lcreate_external(other.c_str(), "/meta", file, "/meta", H5P_DEFAULT, H5P_DEFAULT);
}

void link_events(hid_t file, const std::string&, const std::string& other) {
  H5Ldelete(file, "/events", H5P_DEFAULT);
  H5Lcreate_external(other.c_str(), "/events", file, "/events", H5P_DEFAULT, H5P_DEFAULT);
}

void link_through_soft_links(hid_t file, const std::string&, const std::string& other) {
  H5Ldelete(file, "/samples/position", H5P_DEFAULT);
  H5Lcreate_external(other.c_str(), "/samples", file, "/elsewhere", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_soft("/elsewhere/position", file, "/samples/there", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_soft("there", file, "/samples/position", H5P_DEFAULT, H5P_DEFAULT);
}

void store_externally(hid_t file, const std::string& secret, const std::string&) {
  const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_external(creation, secret.c_str(), 0, kRowsThere * 3 * sizeof(double));
  replace_position(file, creation);
}

void make_virtual(hid_t file, const std::string&, const std::string& other) {
  const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
  const hsize_t rows[] = {kRowsThere, 3};
  const hid_t space = H5Screate_simple(2, rows, nullptr);
  H5Pset_virtual(creation, space, other.c_str(), "/samples/position", space);
  H5Sclose(space);
  replace_position(file, creation);
}

class DataOutsideTheFile : public testing::TestWithParam<WayOut> {};

TEST_P(DataOutsideTheFile, AreNotRead) {
  const WayOut& way = GetParam();
  const TempFolder folder;
  const std::string file = folder / "a.h5", other = folder / "other.h5";
  const std::string secret = folder.write("secret", std::string(kRowsThere * 3 * sizeof(double), '?'));
  RecordingHeader header;
  header.meta = {{"key", "secret"}};
  write_recording(other, random_session(5, kRowsThere, {}), {}, header, {{0.01, 50, "secret"}});
  write_recording(file, random_session(4, kRowsThere, {}));
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  way.put(opened, secret, other);
  H5Fclose(opened);

  const auto refused = [&](const auto& action) {
    expect_error(action, Error::Kind::input, {file, way.where, way.why});
  };
  refused([&] { (void)RecordingReader(file); });
  refused([&] { (void)open_source(file); });
  refused([&] { (void)load_path(file); });
  refused([&] { (void)recover_recording(file, folder / "b.h5"); });
  bool found = false;
  for (const Finding& finding : check_recording(file))
    found = found || (finding.severity == Severity::problem && finding.where.find(way.where) == 0 &&
                      finding.what.find(way.why) != std::string::npos);
  EXPECT_TRUE(found);

  // The other file is not even opened: opening a pipe would block for ever.
  for (const std::string& there : {secret, other}) {
    std::filesystem::remove(there);
    ASSERT_EQ(mkfifo(there.c_str(), 0600), 0);
  }
  refused([&] { (void)RecordingReader(file); });
  EXPECT_FALSE(check_recording(file).empty());
}

INSTANTIATE_TEST_SUITE_P(
    Every, DataOutsideTheFile,
    testing::Values(WayOut{"ExternalLinkToADataset", "/samples/position", "link to another file", link_dataset},
                    WayOut{"ExternalLinkToAGroup", "/samples", "link to another file", link_group},
                    WayOut{"ExternalLinkToMetadata", "/meta", "link to another file", link_metadata},
                    WayOut{"ExternalLinkToEvents", "/events", "link to another file", link_events},
                    WayOut{"ExternalLinkBehindSoftLinks", "/samples/position", "link to another file",
                           link_through_soft_links},
                    WayOut{"ExternalStorage", "/samples/position", "external storage", store_externally},
                    WayOut{"VirtualDataset", "/samples/position", "virtual dataset", make_virtual}),
    [](const auto& test) { return test.param.name; });

TEST(SoftLinks, ThatStayInTheFileAreFollowedAndCirclesAreNot) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(4, kRowsThere, {});
  write_recording(folder / "a.h5", session);
  hid_t file = H5Fopen((folder / "a.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  H5Lmove(file, "/samples/position", file, "/kept", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_soft("/kept", file, "/samples/position", H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(file);
  expect_same(RecordingReader(folder / "a.h5").read(0, kRowsThere), session);

  file = H5Fopen((folder / "a.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  H5Ldelete(file, "/samples/position", H5P_DEFAULT);
  H5Lcreate_soft("/samples/position", file, "/samples/position", H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(file);
  expect_error([&] { (void)RecordingReader(folder / "a.h5"); }, Error::Kind::input, {"lacks /samples/position"});
}

}  // namespace
}  // namespace haptrace
