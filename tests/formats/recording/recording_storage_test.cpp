#include "formats/recording/storage.h"
#include "tests/formats/support.h"

#include <hdf5.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

TEST(Precision, IsReadWithEveryPrefixAndUnit) {
  const Precision precision = parse_precision("1um,2mN,0.5mm/s,3µNm");
  EXPECT_DOUBLE_EQ(precision.position, 1e-6);
  EXPECT_DOUBLE_EQ(precision.force, 2e-3);
  EXPECT_DOUBLE_EQ(precision.velocity, 5e-4);
  EXPECT_DOUBLE_EQ(precision.torque, 3e-6);
  EXPECT_EQ(parse_precision(to_string(precision)), precision);
  EXPECT_TRUE(parse_precision("").lossless());
  EXPECT_DOUBLE_EQ(parse_precision("1m").position, 1);
  EXPECT_DOUBLE_EQ(parse_precision("1nm").position, 1e-9);
  EXPECT_DOUBLE_EQ(parse_precision("1 um").position, 1e-6);
  EXPECT_DOUBLE_EQ(parse_precision("2 microns, 1 mN").position, 2e-6);
  EXPECT_DOUBLE_EQ(parse_precision("2 microns, 1 mN").force, 1e-3);
  EXPECT_DOUBLE_EQ(parse_precision("3 N m").torque, 3);
}

TEST(Precision, ThatMakesNoSenseIsRefusedByName) {
  for (const char* text : {"um", "0um", "-1um", "1", "1kg", "1um;1mN", "1um,", "nanm", "infm"})
    expect_error([&] { (void)parse_precision(text); }, Error::Kind::input, {"positive number with a unit", "1um,1mN"});
  expect_error([&] { (void)parse_precision("1um,5furlong"); }, Error::Kind::input, {"'5furlong'"});
}

/// Returns a hand's smooth movement in encoder counts of `count` [m], with the force of a sensor of 0.2 mN resolution.
std::vector<Sample> movement(std::size_t rows, double count) {
  std::vector<Sample> session(rows);
  std::mt19937 random(9);
  std::normal_distribution<double> noise;
  Vec3 velocity = Vec3::Zero();
  for (std::size_t i = 0; i < rows; ++i) {
    Sample& s = session[i];
    const double t = 1e-3 * static_cast<double>(i);
    s.tick = i;
    s.time_ns = static_cast<std::int64_t>(i) * 1'000'000 + std::llround(1e4 * std::abs(noise(random)));
    for (int axis = 0; axis < 3; ++axis) {
      s.position[axis] = count * std::round(0.05 * std::sin((1.1 + axis) * t) / count);
      if (i > 0) velocity[axis] += 0.3 * ((s.position[axis] - session[i - 1].position[axis]) / 1e-3 - velocity[axis]);
      s.force[axis] = 2e-4 * std::round((2 * std::sin(3 * t + axis) + 1e-2 * noise(random)) / 2e-4);
    }
    s.velocity = velocity;
    s.phase = Phase::run;
    s.latency = static_cast<float>(2e-5 + 1e-6 * noise(random));
  }
  return session;
}

double largest(const std::vector<Sample>& a, const std::vector<Sample>& b, Vec3 Sample::*column) {
  double worst = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, (a[i].*column - b[i].*column).cwiseAbs().maxCoeff());
  return worst;
}

std::uint64_t write(const std::string& file, const std::vector<Sample>& session, const Storage& storage,
                    const RecordingColumns& columns = {}) {
  RecordingWriter writer(file, {}, columns, {.overwrite = true, .storage = storage});
  writer.append(session);
  writer.finish();
  return fs::file_size(file);
}

TEST(Storage, WithDeflateKeepsEveryBitInFewerBytes) {
  const TempFolder folder;
  const std::vector<Sample> session = movement(30'000, 1e-5);
  const std::uint64_t plain = write(folder / "plain.h5", session, {});
  for (const std::size_t rows : {std::size_t{0}, std::size_t{100}}) {
    const std::uint64_t packed = write(folder / "packed.h5", session, {.deflate = 4, .rows_per_chunk = rows});
    EXPECT_LT(static_cast<double>(packed), 0.77 * static_cast<double>(plain)) << "chunks of " << rows;
    expect_same(RecordingReader(folder / "packed.h5").read(0, session.size()), session);
    for (const Finding& finding : check_recording(folder / "packed.h5"))
      ADD_FAILURE() << finding.where << ": " << finding.what;
  }
}

TEST(Storage, OfValuesThatCannotBePackedIsHardlyLargerThanTheValues) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(3, 20'000, {});
  const std::uint64_t plain = write(folder / "plain.h5", session, {});
  const std::uint64_t packed = write(folder / "packed.h5", session, {.deflate = 9});
  EXPECT_LT(static_cast<double>(packed), 1.02 * static_cast<double>(plain));
}

struct Bound {
  const char* text;
  std::size_t rows_per_chunk;
};
class RoundedStorage : public testing::TestWithParam<Bound> {};
INSTANTIATE_TEST_SUITE_P(Bounds, RoundedStorage,
                         testing::Values(Bound{"1um,1mN,1mm/s", 0}, Bound{"1um,1mN,1mm/s", 100},
                                         Bound{"0.5um,0.5mN", 0}, Bound{"3um,7mN,0.2mm/s", 1000}, Bound{"1nm,1nN", 0},
                                         Bound{"1m,1N,1m/s", 0}, Bound{"2mm", 1}));

TEST_P(RoundedStorage, KeepsItsBoundInEverySampleAndEveryBitOfTheRest) {
  const TempFolder folder;
  const Precision precision = parse_precision(GetParam().text);
  const std::vector<Sample> session = movement(20'500, 1e-13);
  write(folder / "a.h5", session, {.deflate = 1, .precision = precision, .rows_per_chunk = GetParam().rows_per_chunk});
  std::vector<Sample> read = RecordingReader(folder / "a.h5").read(0, session.size());
  ASSERT_EQ(read.size(), session.size());
  EXPECT_LE(largest(read, session, &Sample::position), precision.position);
  EXPECT_LE(largest(read, session, &Sample::velocity), precision.velocity);
  EXPECT_LE(largest(read, session, &Sample::force), precision.force);
  if (precision.position > 0 && GetParam().rows_per_chunk != 1) {
    EXPECT_GT(largest(read, session, &Sample::position), 0.01 * precision.position) << "nothing was rounded";
  }
  for (std::size_t i = 0; i < read.size(); ++i) {
    read[i].position = session[i].position;
    read[i].velocity = session[i].velocity;
    read[i].force = session[i].force;
  }
  expect_same(read, session);
}

TEST(RoundedStorage, IsSmallerAtACoarserPrecision) {
  const TempFolder folder;
  const std::vector<Sample> session = movement(30'000, 1e-9);
  std::uint64_t before = write(folder / "a.h5", session, {.deflate = 1});
  for (const char* text : {"0.1um,0.1mN,0.1mm/s", "1um,1mN,1mm/s", "10um,10mN,10mm/s"}) {
    const std::uint64_t bytes = write(folder / "a.h5", session, {.deflate = 1, .precision = parse_precision(text)});
    EXPECT_LT(bytes, before) << text;
    before = bytes;
  }
}

TEST(RoundedStorage, KeepsValuesThatTheFilterCannotHold) {
  const TempFolder folder;
  std::mt19937 random(4);
  std::vector<Sample> session = movement(5000, 1e-9);
  for (int i = 0; i < 40; ++i) {
    const double odd[] = {kNaN, std::numeric_limits<double>::infinity(), 1e300, -1e300, 1e14, 5e-324, -0.0};
    session[random() % session.size()].position[static_cast<int>(random() % 3)] = odd[random() % 7];
  }
  write(folder / "a.h5", session, {.precision = parse_precision("1um"), .rows_per_chunk = 100});
  const std::vector<Sample> read = RecordingReader(folder / "a.h5").read(0, session.size());
  for (std::size_t i = 0; i < session.size(); ++i)
    for (int axis = 0; axis < 3; ++axis) {
      const double a = read[i].position[axis], b = session[i].position[axis];
      EXPECT_TRUE((std::isnan(a) && std::isnan(b)) || a == b || std::abs(a - b) <= 1e-6) << i << ": " << a << " " << b;
    }
}

TEST(RoundedStorage, IsReadByAnyHdf5ProgramWithoutOurHelp) {
  const TempFolder folder;
  const std::vector<Sample> session = movement(3000, 1e-9);
  write(folder / "a.h5", session, {.precision = parse_precision("1um"), .rows_per_chunk = 256});
  const hid_t file = H5Fopen((folder / "a.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t dataset = H5Dopen2(file, "/samples/position", H5P_DEFAULT);
  std::vector<double> values(3 * session.size());
  EXPECT_GE(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  H5Dclose(dataset);
  H5Fclose(file);
  for (std::size_t i = 0; i < session.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(values[3 * i + static_cast<std::size_t>(axis)], session[i].position[axis], 1e-6);
}

TEST(Storage, WithFiltersIsFollowedLiveAndNeverGrowsBeyondTheValues) {
  const TempFolder folder;
  const std::vector<Sample> session = movement(20'000, 1e-5);
  const std::uint64_t plain = write(folder / "plain.h5", session, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {.storage = {.deflate = 1, .rows_per_chunk = 100}});
  for (std::size_t i = 0; i < session.size(); i += 70) {
    writer.append(std::span(session).subspan(i, std::min<std::size_t>(70, session.size() - i)));
    writer.flush();
    if (i % 7000 == 0 && i > 0) {
      const std::uint64_t whole = (i + 70) / 100 * 100;
      const RecordingReader reader(folder / "a.h5");
      EXPECT_EQ(reader.rows(), whole);
      expect_same(reader.read(0, whole), std::span(session).first(whole));
    }
  }
  writer.finish();
  EXPECT_LT(static_cast<double>(fs::file_size(folder / "a.h5")), 0.77 * static_cast<double>(plain));
  expect_same(RecordingReader(folder / "a.h5").read(0, session.size()), session);
}

TEST(Storage, ForHdf5OneEightHasTheOlderSuperblock) {
  const TempFolder folder;
  const std::vector<Sample> session = movement(1000, 1e-5);
  RecordingWriter writer(folder / "a.h5", {.title = "old"}, {}, {.for_hdf5_1_8 = true});
  writer.append(session);
  writer.finish();
  EXPECT_LE(read_bytes(folder / "a.h5")[8], 2) << "version 3 came with HDF5 1.10";
  expect_same(RecordingReader(folder / "a.h5").read(0, session.size()), session);
  EXPECT_EQ(RecordingReader(folder / "a.h5").header().title, "old");
}

}  // namespace
}  // namespace haptrace
