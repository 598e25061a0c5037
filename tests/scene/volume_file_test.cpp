// Volumes in files: what other programs write is read, and what is broken is refused.
#include "formats/volume/volume_file.h"

#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::read_bytes;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;

/// Writes volumes with numpy: of every format, type and byte order, with a list of names and the values expected.
constexpr const char* kWriter = R"(
import gzip, json, os, struct, sys
import numpy as np
os.chdir(sys.argv[1])
rng = np.random.default_rng(1)
nx, ny, nz = 5, 4, 3
types = {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float": "f4", "double": "f8"}
codes = {"int8": 256, "uint8": 2, "int16": 4, "uint16": 512, "int32": 8, "uint32": 768, "float": 16, "double": 64}
other = {"int8": "signed char", "uint8": "unsigned char", "int16": "short", "uint16": "unsigned short int", "int32": "int",
         "uint32": "uint", "float": "float", "double": "double"}
expected = open("expected.txt", "w")

def keep(name, values):
    expected.write(name + " " + " ".join(repr(float(np.float32(v))) for v in values.ravel()) + "\n")

def values(code):
    if code[0] == "f":
        return rng.normal(size=(nz, ny, nx)).astype(code)
    info = np.iinfo(code)
    v = rng.integers(info.min, info.max, size=(nz, ny, nx), endpoint=True).astype(code)
    v[0, 0, 0], v[2, 3, 4] = info.min, info.max
    return v

def nifti(v, code, sign, slope, inter, sform, unit=2, offset=352):
    h = bytearray(348)
    struct.pack_into(sign + "i", h, 0, 348)
    struct.pack_into(sign + "8h", h, 40, 3, nx, ny, nz, 1, 1, 1, 1)
    struct.pack_into(sign + "2h", h, 70, code, 8 * v.dtype.itemsize)
    # qfac -1, and a quarter turn about z: x -> y
    struct.pack_into(sign + "8f", h, 76, -1, 2, 3, 4, 0, 0, 0, 0)
    struct.pack_into(sign + "3f", h, 108, offset, slope, inter)
    h[123] = unit
    struct.pack_into(sign + "2h", h, 252, 0 if sform else 1, 1 if sform else 0)
    struct.pack_into(sign + "6f", h, 256, 0, 0, 0.5 ** 0.5, 10, 20, 30)
    if sform:
        struct.pack_into(sign + "12f", h, 280, 0, -2, 0, 1, 3, 0, 0, 2, 0, 0, 4, 3)
    h[344:348] = b"n+1\0"
    return bytes(h) + bytes(offset - 348) + v.tobytes()

for name, code in types.items():
    for sign, endian in (("<", "little"), (">", "big")):
        v = values(code)
        own = v.astype(sign + code)
        head = "NRRD0004\n# made by a test\ntype: %s\ndimension: 3\nsizes: %d %d %d\n" % (name if sign == "<" else other[name], nx, ny, nz)
        head += "space: right-anterior-superior\nspace directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (1,2,3)\n"
        head += 'space units: "mm" "mm" "mm"\nkey:=value: 5\n'
        if code[1] != "1":
            head += "endian: %s\n" % endian
        for encoding, data in (("raw", own.tobytes()), ("gzip", gzip.compress(own.tobytes())),
                               ("ascii", "\n".join(repr(x) for x in v.ravel().tolist()).encode())):
            base = "%s_%s_%s" % (name, endian, encoding)
            open(base + ".nrrd", "wb").write((head + "encoding: %s\n\n" % encoding).encode() + data)
            keep(base + ".nrrd", v)
            open(base + ".data", "wb").write(b"a line\n" + data)
            open(base + ".nhdr", "w").write(head + "encoding: %s\nline skip: 1\ndata file: %s.data\n" % (encoding, base))
            keep(base + ".nhdr", v)
        for sform in (False, True):
            base = "%s_%s_%d" % (name, endian, sform)
            data = nifti(own, codes[name], sign, 0 if sform else 2, 7, sform)
            scaled = v if sform else 2.0 * v.astype("f8") + 7
            open(base + ".nii", "wb").write(data)
            keep(base + ".nii", scaled)
            open(base + ".nii.gz", "wb").write(gzip.compress(data))
            keep(base + ".nii.gz", scaled)
        base = "%s_%s" % (name, endian)
        open(base + ".raw", "wb").write(own.tobytes())
        json.dump({"file": base + ".raw", "type": name, "sizes": [nx, ny, nz], "spacing": [2, 3, 4], "origin": [1, 2, 3],
                   "endian": endian, "unit": "mm"}, open(base + ".json", "w"))
        keep(base + ".json", v)
)";

/// Writes the volumes once.
const TempFolder& volumes() {
  static const TempFolder folder;
  static const bool written = [] {
    const std::string script = folder.write("write.py", kWriter);
    return std::system(fmt::format(HAPTRACE_PYTHON " {} {}", script, folder.path()).c_str()) == 0;
  }();
  EXPECT_TRUE(written);
  return folder;
}

TEST(VolumeFile, ReadsWhatNumpyWroteInEveryFormatTypeAndByteOrder) {
  std::ifstream expected(volumes() / "expected.txt");
  int files = 0;
  for (std::string line; std::getline(expected, line); ++files) {
    std::istringstream words(line);
    std::string name;
    words >> name;
    const VolumeLoad load = load_volume(volumes() / name, "");
    ASSERT_EQ(load.data.size, (std::array<std::size_t, 3>{5, 4, 3})) << name;
    ASSERT_EQ(load.data.values.size(), 60U);
    for (const float value : load.data.values) {
      double wanted = 0;
      ASSERT_TRUE(words >> wanted);
      ASSERT_EQ(value, static_cast<float>(wanted)) << name;
    }
    EXPECT_EQ(load.data_file.empty(), !name.ends_with(".nhdr") && !name.ends_with(".json")) << name;
    // The places of the header: as the scales and the origin say.
    Eigen::Matrix3d steps = Vec3(0.002, 0.003, 0.004).asDiagonal();
    Vec3 origin(0.001, 0.002, 0.003);
    if (name.find(".nii") != std::string::npos) {
      const bool sform = name.find("_1.nii") != std::string::npos;
      if (sform)
        steps << 0, -0.002, 0, 0.003, 0, 0, 0, 0, 0.004;
      else
        steps << 0, -0.003, 0, 0.002, 0, 0, 0, 0, -0.004;
      if (sform)
        origin = Vec3(0.001, 0.002, 0.003);
      else
        origin = Vec3(0.01, 0.02, 0.03);
    }
    EXPECT_LT((load.data.steps - steps).norm(), 1e-9) << name << '\n' << load.data.steps;
    EXPECT_LT((load.data.origin - origin).norm(), 1e-9) << name;
    EXPECT_TRUE(load.remarks.empty()) << name << ": " << load.remarks[0];
  }
  EXPECT_EQ(files, 8 * 2 * (6 + 4 + 1));
}

/// A header of NRRD with small values, and changes to it.
std::string nrrd(const std::string& lines, const std::string& data, const std::string& type = "uint8") {
  return fmt::format("NRRD0004\ntype: {}\ndimension: 3\nencoding: raw\nendian: little\n{}\n\n{}", type, lines, data);
}

TEST(VolumeFile, PlacesTheGridAsTheFileSays) {
  const TempFolder folder;
  const auto load = [&](const std::string& lines, const std::string& unit = "") {
    return load_volume(folder.write("a.nrrd", nrrd("sizes: 2 2 2\n" + lines, std::string(8, 'x'))), unit);
  };
  const VolumeLoad plain = load("spacings: 1 2 3");
  EXPECT_LT((plain.data.place({1, 1, 1}) - Vec3(1e-3, 2e-3, 3e-3)).norm(), 1e-15) << "mm if no unit is stated";
  EXPECT_THAT(plain.remarks, testing::Contains(HasSubstr("states no unit")));
  EXPECT_LT((load("spacings: 1 2 3\naxis mins: 4 5 6\ncenterings: cell cell cell", "cm").data.origin -
             Vec3(0.045, 0.06, 0.075))
                .norm(),
            1e-15);
  EXPECT_LT((load("axis mins: 4 5 6\ncenters: node node node", "cm").data.origin - Vec3(0.04, 0.05, 0.06)).norm(),
            1e-15);
  const VolumeLoad other = load("spacings: 1 1 1\nunits: \"um\" \"um\" \"um\"", "mm");
  EXPECT_EQ(other.data.steps(0, 0), 1e-3) << "the scene's unit is taken";
  EXPECT_THAT(other.remarks, testing::Contains(HasSubstr("states the unit um")));
  const VolumeLoad lps =
      load("space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (1,2,3)", "m");
  EXPECT_EQ(lps.data.place({1, 0, 0}), Vec3(-2, -2, 3));
  EXPECT_EQ(lps.data.place({0, 1, 0}), Vec3(-1, -3, 3));
  EXPECT_THAT(lps.remarks, testing::Contains(HasSubstr("right-anterior-superior")));
  const VolumeLoad skew = load("space dimension: 3\nspace directions: (1,0,0) (0.1,1,0) (0,0,1)", "cm");
  EXPECT_THAT(skew.remarks, testing::Contains(HasSubstr("axes 1 and 2 of the grid are at 84.3 degrees")));
  EXPECT_LT((skew.data.place({0, 1, 0}) - Vec3(0.001, 0.01, 0)).norm(), 1e-15);
  const std::string last = nrrd("sizes: 2 2 2\nbyte skip: -1\nspacings: 1 1 1", "in front" + std::string("abcdefgh"));
  EXPECT_EQ(load_volume(folder.write("b.nrrd", last), "mm").data.at(1, 0, 1), 'f');
}

TEST(VolumeFile, SaysThatTheFileGoesOnAfterItsValues) {
  const TempFolder folder;
  const auto remarks = [&](const std::string& content) {
    return testing::PrintToString(load_volume(folder.write("a.nrrd", content), "mm").remarks);
  };
  const std::string text = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: text\n\n1 2 3 4 5 6 7 8";
  EXPECT_THAT(remarks(nrrd("sizes: 2 2 2", std::string(9, 'x'))), HasSubstr("continues after its 2 x 2 x 2 values"));
  EXPECT_THAT(remarks(text + " 9"), HasSubstr("continues after its 2 x 2 x 2 values"));
  for (const std::string& whole : {nrrd("sizes: 2 2 2", std::string(8, 'x')), text, text + " \n"})
    EXPECT_THAT(remarks(whole), testing::Not(HasSubstr("continues")));
}

TEST(VolumeFile, NamesTheFileThePlaceAndTheMistake) {
  const TempFolder folder;
  const std::string eight(8, 'x');
  const auto error = [&](const std::string& name, const std::string& content) {
    return error_of([&] { load_volume(folder.write(name, content), "mm"); });
  };
  EXPECT_THAT(error_of([&] { load_volume(folder / "none.nrrd", "mm"); }), HasSubstr("none.nrrd: no such file"));
  EXPECT_THAT(error_of([&] { load_volume(folder.write("a.nrrd", ""), "parsec"); }), HasSubstr("'parsec' is no length"));
  EXPECT_THAT(error("a.dcm", "x"), HasSubstr("give .nrrd, .nhdr, .nii"));
  EXPECT_THAT(error("a.nrrd", "P5 2 2"), HasSubstr("a.nrrd: does not begin with 'NRRD000'"));
  EXPECT_THAT(error("a.nrrd", "NRRD0004\ntype\n\n"), HasSubstr("line 2: 'type' is no 'field: value'"));
  EXPECT_THAT(error("a.nrrd", "NRRD0004\ntype: int8\n\n"), HasSubstr("has no field 'dimension'"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2", "", "block")), HasSubstr("line 2: type 'block' is not known"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2", "", "complex")), HasSubstr("convert it to int8, uint8"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2", eight)), HasSubstr("states 2 sizes"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 8 1 1", eight)), HasSubstr("1 sample along axis 2"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 -2", eight)), HasSubstr("line 6: -2 is not a number of samples"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 nan", eight)), HasSubstr("not a number of samples"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 4096 4096 4096", eight)), HasSubstr("the most is 536 million"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 4294967296 4294967296 2", eight)), HasSubstr("the most is 536 million"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 500 500 500", eight)), HasSubstr("too few for 125000000 values"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2", "1234567")), HasSubstr("has 7 bytes"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nspace directions: (1,0,0) (2,0,0) (0,0,1)", eight)),
              HasSubstr("two are parallel"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nspace directions: (1,0,0) (0,1,0) none", eight)),
              HasSubstr("line 7: expected a direction"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nspacings: 1 0 1", eight)), HasSubstr("do not span the space"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nspacings: 1 1e300 1", eight)), HasSubstr("larger than 1000 km"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nspacings: 1 x 1", eight)), HasSubstr("line 7: 'x' is not a number"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\ndata file: LIST", eight)), HasSubstr("join them into one"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\ndata file: gone.raw", eight)), HasSubstr("gone.raw: no such file"));
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2\nsizes: 2 2 2", eight)), HasSubstr("line 7: 'sizes' is there twice"));
  const auto encoded = [&](const std::string& encoding, const std::string& data) {
    return error("a.nrrd", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: " + encoding + "\n\n" + data);
  };
  EXPECT_THAT(encoded("bzip2", eight), HasSubstr("line 5: encoding 'bzip2' is not known"));
  EXPECT_THAT(encoded("gzip", eight), HasSubstr("are not compressed by gzip"));
  EXPECT_THAT(encoded("ascii", "1 2 3 x 5 6 7 8 "), HasSubstr("value 3 (from 0) is 'x'"));
  EXPECT_THAT(encoded("ascii", "1 2 3 4 5 6 7       "), HasSubstr("ends after 7 of 8 values"));
  EXPECT_THAT(encoded("ascii", "1 2 3 inf 5 6 7 8"), HasSubstr("value 3 (from 0) is inf"));
  std::string floats(32, '\0');
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(floats.data() + 20, &nan, 4);
  EXPECT_THAT(error("a.nrrd", nrrd("sizes: 2 2 2", floats, "float")), HasSubstr("value 5 (from 0) is nan"));
  EXPECT_THAT(error("a.json", R"({"type": "int8", "sizes": [2, 2, 2]})"), HasSubstr("'file' is missing"));
  EXPECT_THAT(error("a.json", R"({"file": "b", "type": "int9", "sizes": [2, 2, 2]})"), HasSubstr("type"));
  EXPECT_THAT(error("a.json", R"({"file": "b", "type": "int8", "sizes": [2, 2, 2.5]})"), HasSubstr("sizes: expected"));
  EXPECT_THAT(error("a.json", R"({"file": "b", "type": "int8", "sizes": [2, 2, 2]})"), HasSubstr("b: no such file"));
  EXPECT_THAT(error("a.json", "[1]"), HasSubstr("expected an object"));
}

TEST(VolumeFile, NamesWhatIsWrongInANiftiHeader) {
  const TempFolder folder;
  const std::string whole = read_bytes(volumes() / "int16_little_0.nii");
  const auto error = [&](std::size_t at, const auto& value) {
    std::string changed = whole;
    std::memcpy(changed.data() + at, &value, sizeof value);
    return error_of([&] { load_volume(folder.write("a.nii", changed), ""); });
  };
  using Short = std::int16_t;
  EXPECT_THAT(error(0, 540), HasSubstr("convert it to NIfTI-1"));
  EXPECT_THAT(error(344, std::array{'n', 'i', '1', '\0'}), HasSubstr("convert it to one file"));
  EXPECT_THAT(error(344, std::array{'x', 'x', 'x', 'x'}), HasSubstr("'n+1'"));
  EXPECT_THAT(error(40, Short{9}), HasSubstr("dim[0] is 9"));
  EXPECT_THAT(error(42, Short{-3}), HasSubstr("dim[1] is -3"));
  EXPECT_THAT(error(40, std::array<Short, 5>{4, 5, 4, 3, 7}), HasSubstr("has 7 volumes"));
  EXPECT_THAT(error(42, std::array<Short, 3>{32767, 32767, 32767}), HasSubstr("the most is 536 million"));
  EXPECT_THAT(error(70, Short{32}), HasSubstr("datatype 32 is not supported"));
  EXPECT_THAT(error(72, Short{32}), HasSubstr("bitpix is 32"));
  EXPECT_THAT(error(80, 0.0F), HasSubstr("spacings must be positive"));
  EXPECT_THAT(error(80, std::numeric_limits<float>::quiet_NaN()), HasSubstr("spacings must be positive"));
  EXPECT_THAT(error(108, -1.0F), HasSubstr("vox_offset is -1"));
  EXPECT_THAT(error(112, std::numeric_limits<float>::infinity()), HasSubstr("scl_slope"));
  EXPECT_THAT(error(112, 3e38F), AllOf(HasSubstr("value "), HasSubstr("single precision")));
  EXPECT_THAT(error(256, 5.0F), HasSubstr("are no rotation"));
  EXPECT_THAT(error(268, std::numeric_limits<float>::infinity()), HasSubstr("not finite"));
}

TEST(VolumeFile, RefusesEveryTruncationAndSurvivesEveryChangedByte) {
  const TempFolder folder;
  int refused = 0, read = 0;
  for (const char* name :
       {"int16_big_raw.nrrd", "int16_big_gzip.nrrd", "uint8_little_raw.nrrd", "double_little_gzip.nrrd",
        "float_little_0.nii", "float_big_1.nii.gz", "int32_little_1.nii.gz"}) {
    const std::string whole = read_bytes(volumes() / name);
    const std::string ending = std::string(name).substr(std::string(name).find('.'));
    const auto loads = [&](const std::string& content) {
      try {
        (void)load_volume(folder.write("a" + ending, content), "");
        return true;
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), Error::Kind::input);
        EXPECT_THAT(error.what(), HasSubstr("a" + ending));
        return false;
      }
    };
    ASSERT_TRUE(loads(whole));
    for (std::size_t length = 0; length < whole.size(); length += 7, ++refused)
      ASSERT_FALSE(loads(whole.substr(0, length))) << name << " cut to " << length;
    for (std::size_t at = 0; at < whole.size(); ++at) {
      std::string changed = whole;
      changed[at] = at % 3 == 0 ? '\0' : at % 3 == 1 ? '\xff' : static_cast<char>(whole[at] + 1);
      read += loads(changed) ? 1 : 0;
    }
  }
  EXPECT_GT(refused, 300);
  EXPECT_GT(read, 300);
}

}  // namespace
}  // namespace haptrace
