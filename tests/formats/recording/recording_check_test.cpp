#include "formats/recording/recording.h"
#include "tests/formats/support.h"

#include <fmt/format.h>
#include <hdf5.h>

namespace haptrace {
namespace {

const RecordingColumns kAll{true, true, true, true, true, true};

std::string text_of(const std::vector<Finding>& findings) {
  std::string text;
  for (const Finding& finding : findings)
    text += fmt::format("{} {}: {}\n", to_string(finding.severity), finding.where, finding.what);
  return text;
}

void expect_finding(const std::vector<Finding>& findings, Severity severity, const std::string& where,
                    const std::string& what) {
  for (const Finding& finding : findings)
    if (finding.severity == severity && finding.where == where && finding.what.find(what) != std::string::npos) return;
  ADD_FAILURE() << "no finding " << where << ": " << what << "\nfound:\n" << text_of(findings);
}

/// Writes a recording with one defect in its values and expects exactly one finding.
void expect_value_finding(
    const std::function<void(std::vector<Sample>&, std::vector<StoredEvent>&, RecordingHeader&)>& damage,
    Severity severity, const std::string& where, const std::string& what) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(1, 300, kAll);
  std::vector<StoredEvent> events{{0.1, 50, "mark"}};
  RecordingHeader header;
  damage(session, events, header);
  write_recording(folder / "a.h5", session, kAll, header, events);
  const std::vector<Finding> findings = check_recording(folder / "a.h5");
  expect_finding(findings, severity, where, what);
  EXPECT_EQ(findings.size(), 1U) << text_of(findings);
}

TEST(CheckRecording, FindsNothingInAGoodRecording) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(1, 20'000, kAll), kAll, {}, {{0.1, 50, "mark"}});
  EXPECT_EQ(text_of(check_recording(folder / "a.h5")), "");
}

TEST(CheckRecording, NamesTheRowOfAnInvalidValue) {
  using Rows = std::vector<Sample>;
  using Events = std::vector<StoredEvent>;
  using Header = RecordingHeader;
  const double infinity = std::numeric_limits<double>::infinity();
  expect_value_finding([](Rows& s, Events&, Header&) { s[7].position.y() = kNaN; }, Severity::problem,
                       "/samples/position[7]", "is NaN");
  expect_value_finding(
      [&](Rows& s, Events&, Header&) {
        s[7].velocity.y() = infinity;
        s[9].velocity.x() = -infinity;
      },
      Severity::problem, "/samples/velocity[7]", "is infinite (2 rows in all)");
  expect_value_finding([](Rows& s, Events&, Header&) { s[3].force.z() = kNaN; }, Severity::problem, "/samples/force[3]",
                       "is NaN (1 rows in all); the column must have a value in every row or in none");
  expect_value_finding([](Rows& s, Events&, Header&) { s[299].latency = std::numeric_limits<float>::quiet_NaN(); },
                       Severity::problem, "/samples/latency[299]", "is NaN");
  expect_value_finding(
      [](Rows& s, Events&, Header&) {
        s[5].latency = -2e-6F;
        s[5].time_ns -= 7000;
      },
      Severity::warning, "/samples/latency[5]", "is negative: -2e-06 s");
  expect_value_finding([](Rows& s, Events&, Header&) { s[8].time_ns = s[7].time_ns; }, Severity::problem,
                       "/samples/time[8]", "0.007 s does not come after 0.007 s of the row before");
  expect_value_finding(
      [](Rows& s, Events&, Header&) {
        for (std::size_t i = 8; i < s.size(); ++i) --s[i].tick;
      },
      Severity::problem, "/samples/tick[8]", "7 does not come after 7 of the row before");
  expect_value_finding(
      [](Rows& s, Events&, Header&) {
        for (std::size_t i = 200; i < 300; ++i) s[i].time_ns += 5'000'000;
      },
      Severity::warning, "/samples/time[200]", "away from tick / rate_hz + latency (100 rows in all)");
  expect_value_finding([](Rows& s, Events&, Header&) { s[4].orientation = Quat(2, 0, 0, 0); }, Severity::problem,
                       "/samples/orientation[4]", "is not a unit quaternion: its norm is 2");
  expect_value_finding([](Rows& s, Events&, Header&) { s[4].phase = static_cast<Phase>(6); }, Severity::problem,
                       "/samples/phase[4]", "is 6, which is not a phase (0 to 5)");
  expect_value_finding(
      [](Rows& s, Events&, Header& h) {
        h.max_force_n = 5;
        s[11].force = Vec3(3, 4, 1);
      },
      Severity::problem, "/samples/force[11]", "has the magnitude 5.09902 N, more than max_force_n = 5 N");
  expect_value_finding(
      [](Rows&, Events& e, Header&) {
        e.push_back({7, 50, ""});
      },
      Severity::warning, "/events[1]", "its time, 7 s, is outside the samples' 0 to 0.299 s");
  expect_value_finding([](Rows&, Events& e, Header&) { e[0].code = 0; }, Severity::problem, "/events[0]",
                       "its code, 0, is not positive");
  expect_value_finding(
      [](Rows& s, Events& e, Header&) {
        s.clear();
        e.clear();
      },
      Severity::warning, "/samples", "there are no samples");
}

TEST(CheckRecording, AcceptsColumnsThatAreUnknownThroughout) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(2, 100, kAll);
  for (Sample& s : session) {
    s.velocity = s.force = nan3();
    s.orientation = nan_quat();
    s.reference_position = s.reference_force = nan3();
  }
  write_recording(folder / "a.h5", session, kAll);
  EXPECT_EQ(text_of(check_recording(folder / "a.h5")), "");
}

TEST(CheckRecording, WarnsOfMissingTicksUnlessAnEventReportsThem) {
  const auto miss = [](std::vector<Sample>& s) { s.erase(s.begin() + 50, s.begin() + 80); };
  expect_value_finding([&](std::vector<Sample>& s, std::vector<StoredEvent>&, RecordingHeader&) { miss(s); },
                       Severity::warning, "/samples/tick[50]",
                       "30 ticks are missing before it, and no event reports them");
  // If a device repeats its state for less than 20 ms, the loop stores no sample and no event.
  const TempFolder short_gap;
  std::vector<Sample> repeated = random_session(3, 300, {});
  repeated.erase(repeated.begin() + 50, repeated.begin() + 65);
  write_recording(short_gap / "a.h5", repeated, {}, {}, {});
  EXPECT_EQ(text_of(check_recording(short_gap / "a.h5")), "");
  for (const std::int32_t code : {10, 11}) {
    const TempFolder folder;
    std::vector<Sample> session = random_session(3, 300, {});
    miss(session);
    write_recording(folder / "a.h5", session, {}, {}, {{0.05, code, "told"}});
    EXPECT_EQ(text_of(check_recording(folder / "a.h5")), "");
  }
}

TEST(CheckRecording, WarnsOfARecordingThatWasNotFinished) {
  const TempFolder folder;
  {
    RecordingWriter writer(folder / "a.h5", {}, {}, {});
    writer.append(random_session(4, 10, {}));
  }
  EXPECT_EQ(text_of(check_recording(folder / "a.h5")),
            "warning /@complete: the recording was not finished: its writer is still running, was killed or failed\n");
}

TEST(CheckRecording, ThrowsOnlyWhenThereIsNothingToCheck) {
  const TempFolder folder;
  expect_error([&] { check_recording(folder / "absent.h5"); }, Error::Kind::input, {"absent.h5: no such file"});
  expect_error([&] { check_recording(folder.write("a.csv", "t,x,y,z\n")); }, Error::Kind::input,
               {"is not an HDF5 file"});
}

// ---- structure, damaged with HDF5 itself ----

void replace_text(hid_t object, const char* name, const std::string& text) {
  if (H5Aexists(object, name) > 0) H5Adelete(object, name);
  const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
  H5Tset_size(type, text.size() + 1);
  const hid_t attribute = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(attribute, type, text.c_str());
  H5Aclose(attribute);
  H5Sclose(space);
  H5Tclose(type);
}

void replace_number(hid_t object, const char* name, double value) {
  H5Adelete(object, name);
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t attribute = H5Acreate2(object, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(attribute, H5T_NATIVE_DOUBLE, &value);
  H5Aclose(attribute);
  H5Sclose(space);
}

/// Replaces a dataset by one of this type and shape. The new dataset is chunked with `fill` as its fill value, unless
/// `contiguous`.
void replace_dataset(hid_t file, const char* path, hid_t type, const std::vector<hsize_t>& shape,
                     bool contiguous = false, double fill = kNaN) {
  H5Ldelete(file, path, H5P_DEFAULT);
  const std::vector<hsize_t> chunk(shape.size(), 1);
  std::vector<hsize_t> limits = shape;
  limits[0] = contiguous ? shape[0] : H5S_UNLIMITED;
  const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), limits.data());
  const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
  if (!contiguous) H5Pset_chunk(creation, static_cast<int>(shape.size()), chunk.data());
  if (H5Tget_class(type) == H5T_FLOAT) H5Pset_fill_value(creation, H5T_NATIVE_DOUBLE, &fill);
  const hid_t dataset = H5Dcreate2(file, path, type, space, H5P_DEFAULT, creation, H5P_DEFAULT);
  replace_text(dataset, "units", "m");
  replace_text(dataset, "description", "damaged");
  H5Dclose(dataset);
  H5Pclose(creation);
  H5Sclose(space);
}

using Damage = std::function<void(hid_t file)>;

struct Case {
  const char* name;
  Damage damage;
  std::string where, what;
  std::string reader_says;  ///< Error of RecordingReader; empty if it reads the file.
};

class DamagedStructure : public testing::TestWithParam<Case> {};

TEST_P(DamagedStructure, IsReportedWithItsPlace) {
  const TempFolder folder;
  const std::string name = folder / "a.h5";
  write_recording(name, random_session(5, 60, kAll), kAll, {}, {{0.01, 50, "mark"}});
  const hid_t file = H5Fopen(name.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  H5Ldelete(file, "/checksums", H5P_DEFAULT);  // files of other programs have no checksums either
  GetParam().damage(file);
  H5Fclose(file);
  expect_finding(check_recording(name), Severity::problem, GetParam().where, GetParam().what);
  const auto read = [&] { return RecordingReader(name).read(0, 60); };
  if (GetParam().reader_says.empty())
    EXPECT_NO_THROW(read());
  else
    expect_error(read, Error::Kind::input, {name + ": " + GetParam().reader_says});
}

Damage without_attribute(const char* name) {
  return [name](hid_t file) { H5Adelete(file, name); };
}
Damage with_text(const char* name, const std::string& text) {
  return [name, text](hid_t file) { replace_text(file, name, text); };
}
Damage with_number(const char* name, double value) {
  return [name, value](hid_t file) { replace_number(file, name, value); };
}
Damage without(const char* path) {
  return [path](hid_t file) { H5Ldelete(file, path, H5P_DEFAULT); };
}

INSTANTIATE_TEST_SUITE_P(
    EveryFinding, DamagedStructure,
    testing::Values(
        Case{"NoFormat", without_attribute("format"), "/@format", "is not 'haptrace-recording'",
             "is HDF5, but not a haptrace recording"},
        Case{"OtherFormat", with_text("format", "nwb"), "/@format", "is not 'haptrace-recording'",
             "is HDF5, but not a haptrace recording"},
        Case{"NewerMajorVersion", with_text("format_version", "2.0"), "/@format_version", "'2.0' is not a version 1.x",
             "format_version 2.0 is newer than this program supports (1.x)"},
        Case{"NoVersion", with_text("format_version", "new"), "/@format_version", "'new' is not a version 1.x",
             "format_version 'new' is not of the form 1.0"},
        Case{"NoUuid", without_attribute("uuid"), "/@uuid", "is missing", ""},
        Case{"BadUuid", with_text("uuid", "12345"), "/@uuid", "'12345' is not a UUID", ""},
        Case{"LocalTime", with_text("created", "2026-01-31T12:00:00"), "/@created", "is not a time of RFC 3339 in UTC",
             ""},
        Case{"NoSuchTime", with_text("created", "2026-13-31T12:00:00Z"), "/@created",
             "is not a time of RFC 3339 in UTC", ""},
        Case{"OtherClock", with_text("clock", "wall"), "/@clock", "'wall' is not 'monotonic' or 'virtual'", ""},
        Case{"TextForNumber", with_text("rate_hz", "1000"), "/@rate_hz", "is not a number", ""},
        Case{"NumberForText", with_number("title", 7), "/@title", "is not text", ""},
        Case{"ZeroRate", with_number("rate_hz", 0), "/@rate_hz", "0 is not positive", ""},
        Case{"NanForce", with_number("max_force_n", kNaN), "/@max_force_n", "is not a finite number", ""},
        Case{"FloatComplete", with_number("complete", 1), "/@complete", "is not an integer, 0 or 1", ""},
        Case{"BrokenConfig", with_text("config", "{\"a\": "), "/@config", "not JSON: line 1, column 7",
             "attribute config: line 1, column 7"},
        Case{"NoPosition", without("/samples/position"), "/samples/position", "is missing",
             "is not a complete recording: it lacks /samples/position"},
        Case{"NoSamples", without("/samples"), "/samples/time", "is missing",
             "is not a complete recording: it lacks /samples/time, /samples/tick, /samples/position"},
        Case{"HalfAReference", without("/samples/reference_velocity"), "/samples/reference_velocity", "is missing",
             "is not a complete recording: it lacks /samples/reference_velocity"},
        Case{"NoEvents", without("/events"), "/events", "is missing", "is not a complete recording: it lacks /events"},
        Case{"PlainEvents", [](hid_t f) { replace_dataset(f, "/events", H5T_IEEE_F64LE, {3}); }, "/events",
             "is not a compound", "/events is not a list of time, code and text"},
        Case{"IntegerPosition",
             [](hid_t f) {
               replace_dataset(f, "/samples/position", H5T_STD_I32LE, {60, 3});
             },
             "/samples/position", "does not hold little-endian float64", "/samples/position does not hold float64"},
        Case{"NarrowPosition",
             [](hid_t f) {
               replace_dataset(f, "/samples/position", H5T_IEEE_F32LE, {60, 3});
             },
             "/samples/position", "does not hold little-endian float64", ""},
        Case{"WrongWidth",
             [](hid_t f) {
               replace_dataset(f, "/samples/force", H5T_IEEE_F64LE, {60, 2});
             },
             "/samples/force", "has the shape [60, 2] instead of [N, 3]",
             "/samples/force has the shape [60, 2] instead of [N, 3]"},
        Case{"WrongRank",
             [](hid_t f) {
               replace_dataset(f, "/samples/time", H5T_IEEE_F64LE, {60, 1});
             },
             "/samples/time", "has the shape [60, 1] instead of [N]",
             "/samples/time has the shape [60, 1] instead of [N]"},
        Case{"ShortColumn", [](hid_t f) { replace_dataset(f, "/samples/buttons", H5T_STD_U32LE, {59}); },
             "/samples/buttons", "has 59 rows where others have 60",
             "/samples/buttons has 59 rows where /samples/time has 60"},
        Case{"Contiguous",
             [](hid_t f) {
               replace_dataset(f, "/samples/force", H5T_IEEE_F64LE, {60, 3}, true);
             },
             "/samples/force", "is not chunked", ""},
        Case{"ZeroFill",
             [](hid_t f) {
               replace_dataset(f, "/samples/force", H5T_IEEE_F64LE, {60, 3}, false, 0);
             },
             "/samples/force", "its fill value is 0 instead of NaN", ""},
        Case{"OtherUnits",
             [](hid_t f) {
               replace_dataset(f, "/samples/force", H5T_IEEE_F64LE, {60, 3});
             },
             "/samples/force/@units", "is 'm' instead of 'N'", ""},
        Case{"NoDescription",
             [](hid_t f) {
               const hid_t dataset = H5Dopen2(f, "/samples/force", H5P_DEFAULT);
               H5Adelete(dataset, "description");
               H5Dclose(dataset);
             },
             "/samples/force/@description", "is missing", ""}),
    [](const auto& each) { return std::string(each.param.name); });

}  // namespace
}  // namespace haptrace
