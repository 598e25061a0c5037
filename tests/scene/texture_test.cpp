// Textures: heights and gradients, their statistics, the work of a scan, and their files.
#include "formats/image/grey_image.h"
#include "scene/surface/detailed.h"
#include "scene/surface/texture/grid_height.h"
#include "scene/surface/texture/noise.h"
#include "tests/scene/alone.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <cstdlib>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;
using test::Alone;
using test::error_of;
using test::TempFolder;
using testing::HasSubstr;

/// An image of 32 x 32 pixels, as a text.
std::string pgm_of_waves(int white) {
  std::string text = fmt::format("P2\n# waves\n32 32\n{}\n", white);
  for (int row = 0; row < 32; ++row)
    for (int column = 0; column < 32; ++column)
      text += fmt::format(
          "{} ", std::lround(white * 0.5 * (1 + std::cos(2 * pi * column / 16) * std::sin(2 * pi * row / 32))));
  return text;
}

/// Returns every kind of texture as in a scene file: amplitude 0.2 mm and waves of about 2 mm.
std::map<std::string, std::string> every_texture(const std::string& image) {
  return {
      {"Perlin", R"("kind": "perlin", "amplitude": 2e-4, "wavelength": 2e-3)"},
      {"Fbm", R"("kind": "fractal", "amplitude": 2e-4, "wavelength": 2e-3, "octaves": 3)"},
      {"Ridged", R"("kind": "fractal", "amplitude": 2e-4, "wavelength": 2e-3, "sum": "ridged", "octaves": 2)"},
      {"Turbulence", R"("kind": "fractal", "amplitude": 2e-4, "wavelength": 2e-3, "sum": "turbulence", "octaves": 2)"},
      {"Fourier", R"("kind": "fourier", "waves": [{"wavelength": 2e-3, "amplitude": 2e-4, "direction": [1, 0.3, 0.1]},
                                                  {"wavelength": 3e-3, "amplitude": 1e-4, "direction": [0, 1, 0], "phase": 1}])"},
      {"Expression", R"("kind": "expression", "wavelength": 2e-3,
                        "height": "2e-4*sin(2*pi*u/0.002)*cos(2*pi*v/0.003) + 0")"},
      {"Pink", R"("kind": "pink", "amplitude": 1e-4, "wavelength": 8e-3, "shortest": 1.5e-3)"},
      {"Spots", R"("kind": "spots", "amplitude": 1e-4, "wavelength": 2e-3)"},
      {"Cellular", R"("kind": "cellular", "amplitude": 2e-4, "wavelength": 2e-3)"},
      {"CellEdges", R"("kind": "cellular", "amplitude": 2e-4, "wavelength": 2e-3, "distance": "f2-f1")"},
      {"Image",
       fmt::format(R"("kind": "image", "file": "{}", "amplitude": 2e-4, "mapping": {{"size": 0.004}})", image)},
      {"Reaction",
       R"("kind": "reaction-diffusion", "amplitude": 2e-4, "side": 64, "steps": 1500, "mapping": {"size": 0.02})"},
  };
}

Texture texture_of(const std::string& keys) {
  SceneFiles files;
  const nlohmann::json json = parse_json("{" + keys + "}", "test");
  Texture texture = read_texture(JsonReader(json, "test"), files);
  texture.height->prepare();
  return texture;
}

class Textures : public testing::Test {
 protected:
  TempFolder folder_;
  std::map<std::string, std::string> all_ = every_texture(folder_.write("waves.pgm", pgm_of_waves(255)));
};

TEST_F(Textures, HaveTheGradientOfTheirHeight) {
  for (const auto& [name, keys] : all_) {
    const Texture texture = texture_of(keys);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> side(-0.01, 0.01);
    constexpr double kStep = 1e-8;
    int far_off = 0;
    for (int i = 0; i < 300; ++i) {
      const Vec3 place(side(random), side(random), side(random));
      const HeightSample here = texture.height->at(place, 0);
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3 step = kStep * Vec3::Unit(axis);
        const double slope =
            (texture.height->at(place + step, 0).value - texture.height->at(place - step, 0).value) / (2 * kStep);
        far_off += std::abs(slope - here.gradient[axis]) > 1e-4 * (0.1 + std::abs(slope)) ? 1 : 0;
      }
    }
    // The distance to the nearest of several points has kinks, which a difference may span.
    EXPECT_LE(far_off, name.starts_with("Cell") ? 2 : 0) << name;
  }
}

struct Scan {
  double given = 0;  ///< net work of the contact on the tool [J]
  double work = 0;   ///< sum of the magnitudes [J]
};

/// Moves a tool once along a closed ellipse of 5 by 3 mm, 1 to 3 mm deep, and calls `look` with every contact.
template <class Look>
Scan closed_scan(Alone& object, int steps, const Look& look) {
  Scan scan;
  Contact before;
  Vec3 last = Vec3::Zero();
  for (int i = 0; i <= steps; ++i) {
    const double a = 2 * pi * i / steps;
    const Vec3 place(5e-3 * std::cos(a), 3e-3 * std::sin(a), -2e-3 - 1e-3 * std::cos(a + 0.7));
    const Contact contact = object.answer({.position = place, .dt = 1e-3});
    look(contact);
    if (i > 0) {
      const double done = 0.5 * (before.force + contact.force).dot(place - last);
      scan.given += done;
      scan.work += std::abs(done);
    }
    before = contact;
    last = place;
  }
  return scan;
}

TEST_F(Textures, TakeAndGiveNoWorkInAClosedScanOfAPotential) {
  for (const char* shape : {R"("kind": "plane", "point": 0, "normal": [0, 0, 1])",
                            R"("kind": "sphere", "radius": 0.03, "centre": [0, 0, -0.03])"})
    for (const auto& [name, keys] : all_) {
      if (name.starts_with("Cell")) continue;  // see below: the force jumps at its kinks
      Alone object(fmt::format(R"({{{}, "stiffness": 1000, "texture": {{{}}}}})", shape, keys));
      const Scan scan = closed_scan(object, 200'000, [](const Contact&) {});
      EXPECT_GT(scan.work, 1e-3) << name;
      EXPECT_LT(std::abs(scan.given), 2e-7 * scan.work) << name << " on " << shape;
    }
}

TEST_F(Textures, GiveWorkInAClosedScanUnderTheBumpLaw) {
  const auto share_of = [](const std::string& keys) {
    Alone object(R"({"kind": "plane", "point": 0, "normal": [0, 0, 1], "stiffness": 1000, "texture": {"law": "bump",)" +
                 keys + "}}");
    const Scan scan = closed_scan(object, 100'000, [](const Contact& contact) {
      EXPECT_NEAR(contact.force.norm(), 1000 * contact.depth, 1e-9) << "it turns the force and keeps its size";
    });
    return std::abs(scan.given) / scan.work;
  };
  for (const auto& [name, keys] : all_) EXPECT_LT(share_of(keys), 0.03) << name << ", as docs/scene.md states";
  const double sine = share_of(R"("kind": "fourier", "waves": [{"wavelength": 2e-3, "amplitude": 2e-4}])");
  EXPECT_GT(sine, 1e-3) << "this is what the potential avoids";
  EXPECT_LT(sine, 0.015);
}

TEST(ExpressionTexture, IsItsFormulaAndDeclaresItsMeasuredAmplitude) {
  const Texture texture =
      texture_of(R"("kind": "expression", "height": "3e-4*sin(2*pi*u/0.002) + 1e-4*v/0.1", "wavelength": 2e-3)");
  for (const double u : {0.0, 0.0003, -0.0117}) {
    const HeightSample sample = texture.height->at({u, 0.02, 5}, 0);
    EXPECT_NEAR(sample.value, 3e-4 * std::sin(2 * pi * u / 0.002) + 2e-5, 1e-16);
    EXPECT_NEAR(sample.gradient.x(), 3e-4 * 2 * pi / 0.002 * std::cos(2 * pi * u / 0.002), 1e-12);
    EXPECT_NEAR(sample.gradient.y(), 1e-3, 1e-15);
    EXPECT_EQ(sample.gradient.z(), 0);
  }
  EXPECT_NEAR(texture.height->amplitude(), 4e-4, 4e-6) << "within 0.1 m";
  EXPECT_LE(texture.height->amplitude(), 4e-4);
  EXPECT_EQ(texture.height->wavelength(), 2e-3);
  EXPECT_EQ(texture.height->at({0.0005, 0, 0}, 0.004).value, 0) << "faded";
  // Around a cylinder u is an angle times the size: 20 waves.
  const Texture round = texture_of(R"("kind": "expression", "height": "1e-4*cos(2*pi*u/0.001) + 0", "wavelength": 1e-3,
      "mapping": {"kind": "cylinder", "size": 0.02})");
  for (const double a : {0.0, 0.1, 2.0})
    EXPECT_NEAR(round.height->at(0.03 * Vec3(std::cos(a), std::sin(a), 0), 0).value, 1e-4 * std::cos(20 * a), 1e-15);
}

TEST(ExpressionTexture, IsRefusedWithTheReason) {
  const auto keys = [](const std::string& height) {
    return fmt::format(R"("kind": "expression", "wavelength": 1e-3, "height": "{}")", height);
  };
  const auto error = [&](const std::string& height) { return error_of([&] { (void)texture_of(keys(height)); }); };
  EXPECT_THAT(error("sin(x)"), testing::AllOf(HasSubstr("height: column 5"), HasSubstr("known: u, v, pi")));
  EXPECT_THAT(error("sin(u*100)"), testing::AllOf(HasSubstr("height: the height is"), HasSubstr("metres")));
  EXPECT_THAT(error("1/(u-u)"), HasSubstr("height: the height is not a number"));
  EXPECT_THAT(error_of([] { (void)texture_of(R"("kind": "expression", "height": "u")"); }), HasSubstr("wavelength"));
  const Texture broken = texture_of(keys("1e-6*log(u)"));
  EXPECT_EQ(broken.height->at({-0.01, 0, 0}, 0).value, 0) << "no height where it is not finite";
  EXPECT_EQ(broken.height->at({0, 0, 0}, 0).gradient, Vec3::Zero());
}

TEST_F(Textures, FadeWhereTheToolIsTooFastForTheRate) {
  Alone object(R"({"kind": "plane", "point": 0, "normal": [0, 0, 1], "stiffness": 1000, "texture": {)" +
               all_.at("Fourier") + "}}");
  const Vec3 place(1e-3, 5e-4, -2e-3);
  const auto force = [&](double speed) { return object.answer({place, Vec3(speed, 0, 0), 1e-3}).force; };
  const Vec3 slow = force(0), limit = force(2e-3 * 1000 / 5 * 0.999), fast = force(10);
  EXPECT_EQ(slow, limit) << "unchanged up to a fifth of the rate";
  EXPECT_LT((fast - Vec3(0, 0, 2)).norm(), 1e-12) << "smooth at high speed";
  EXPECT_GT((slow - Vec3(0, 0, 2)).norm(), 0.05);
  Vec3 before = slow;
  for (double speed = 0.3; speed < 1.4; speed += 1e-3) {
    const Vec3 now = force(speed);
    EXPECT_LT((now - before).norm(), 0.02) << "and no step on the way";
    before = now;
  }
}

TEST_F(Textures, DeclareTheirVibrationAndNoneToAToolThatRests) {
  Alone object(R"({"kind": "plane", "point": 0, "normal": [0, 0, 1], "stiffness": 1000, "texture": {)" +
               all_.at("Fourier") + "}}");
  EXPECT_EQ(object.answer({Vec3(0, 0, -2e-3), Vec3::Zero(), 1e-3}).vibration, 0);
  EXPECT_EQ(object.answer({Vec3(0, 0, 1e-3), Vec3(0.1, 0, 0), 1e-3}).vibration, 0);
  const double declared = object.answer({Vec3(0, 0, -2e-3), Vec3(0.1, 0, 0), 1e-3}).vibration;
  double most = 0;
  for (int i = 0; i < 2000; ++i)
    most = std::max(
        most, (object.answer({Vec3(1e-5 * i, 2e-6 * i, -2e-3), Vec3(0.01, 0, 0), 1e-3}).force - Vec3(0, 0, 2)).norm());
  EXPECT_GT(declared, 0.5 * most);
  EXPECT_LT(declared, 3 * most);
}

TEST_F(Textures, BoundTheirHeightsAndSlopesWithinAFactorOfTwo) {
  std::map<std::string, std::string> all = all_;
  all["Fractal"] = R"("kind": "fractal", "amplitude": 3e-4, "wavelength": 5e-3)";
  all["Rough"] = R"("kind": "fractal", "amplitude": 3e-4, "wavelength": 5e-3, "octaves": 8, "hurst": 0.3)";
  all["Sparse"] = R"("kind": "spots", "amplitude": 1e-4, "wavelength": 2e-3, "density": 0.5)";
  all["OneWave"] = R"("kind": "fourier", "waves": [{"wavelength": 2e-3, "amplitude": 1e-4, "direction": [1, 2, 2]}])";
  all["ManyWaves"] = R"("kind": "pink", "amplitude": 1e-4, "wavelength": 8e-3, "shortest": 1.5e-3, "waves": 128)";
  all["Linear"] = all_.at("Image") + R"(, "order": 1)";
  for (const auto& [name, keys] : all) {
    const Texture texture = texture_of(keys);
    const HeightRange range = texture.height->range();
    std::mt19937 random(11);
    std::uniform_real_distribution<double> side(-0.05, 0.05);
    double steepest = 0, declared = 0, low = 1, high = -1;
    for (int i = 0; i < 60'000; ++i) {
      const HeightSample sample = texture.height->at({side(random), side(random), side(random)}, 0);
      steepest = std::max(steepest, sample.gradient.norm());
      declared = std::max(declared, sample.steepest);
      low = std::min(low, sample.value);
      high = std::max(high, sample.value);
      ASSERT_LE(sample.gradient.norm(), sample.steepest * (1 + 1e-12)) << name;
    }
    EXPECT_LE(declared, 2.1 * steepest) << name;
    EXPECT_LE(range.low, low) << name;
    EXPECT_GE(range.high, high) << name;
    EXPECT_LE(range.high - range.low, 2.1 * (high - low)) << name;
  }
}

TEST_F(Textures, BoundTheSlopeOfAMappedImage) {
  for (const char* kind : {"plane", "cylinder", "sphere", "cube"})
    for (const char* height :
         {R"("kind": "reaction-diffusion", "amplitude": 2e-4, "side": 64, "steps": 1500)",
          R"("kind": "expression", "wavelength": 2e-3, "height": "2e-4*sin(2*pi*u/0.002)*cos(2*pi*v/0.002) + 0")"}) {
      const Texture texture =
          texture_of(fmt::format(R"({}, "mapping": {{"kind": "{}", "size": 0.02, "repeat": 3}})", height, kind));
      std::mt19937 random(12);
      std::uniform_real_distribution<double> side(-0.03, 0.03);
      for (int i = 0; i < 20'000; ++i) {
        const HeightSample sample = texture.height->at({side(random), side(random), side(random)}, 0);
        ASSERT_LE(sample.gradient.norm(), sample.steepest * (1 + 1e-12)) << kind << ": " << height;
      }
    }
}

TEST_F(Textures, DeclareTheVibrationOfTheirForceWithinAFactorOfThree) {
  // A tilted plane, so that its points lie between the points of every lattice, and a ball.
  const Vec3 normal = Vec3(0.3, 0.2, 1).normalized();
  const Vec3 across = normal.cross(Vec3::UnitX()).normalized(), along = normal.cross(across);
  for (const char* law : {"potential", "bump"})
    for (const auto& [name, keys] : all_) {
      const std::string surface = fmt::format(R"("stiffness": 1000, "texture": {{"law": "{}", {}}}}})", law, keys);
      Alone plane(R"({"kind": "plane", "point": 0, "normal": [0.3, 0.2, 1], )" + surface);
      Alone ball(R"({"kind": "sphere", "radius": 0.03, )" + surface);
      std::mt19937 random(13);
      std::uniform_real_distribution<double> side(-0.03, 0.03);
      std::normal_distribution<double> any;
      for (Alone* object : {&plane, &ball}) {
        double low = 1e9, high = -1e9, sideways = 0, least = 1e9;
        const bool flat = object == &plane;
        for (int i = 0; i < 10'000; ++i) {
          const Vec3 up = Vec3(any(random), any(random), 0.5 + std::abs(any(random))).normalized();
          const Vec3 out = flat ? normal : up;
          const Vec3 place =
              flat ? Vec3(side(random) * across + side(random) * along - 2e-3 * normal) : Vec3(0.028 * up);
          const Vec3 velocity = 0.1 * (flat ? across : Vec3(up.unitOrthogonal()));
          if (!flat) {  // every contact with the ball begins above it
            object->reset();
            (void)object->answer({.position = 0.04 * up});
          }
          const Contact contact = object->answer({place, velocity, 1e-3});
          ASSERT_TRUE(contact.touched()) << name;
          low = std::min(low, contact.force.dot(out));
          high = std::max(high, contact.force.dot(out));
          sideways = std::max(sideways, (contact.force - contact.force.dot(out) * out).norm());
          least = std::min(least, contact.vibration);
        }
        const double real = std::max(0.5 * (high - low), sideways);
        EXPECT_GE(least, (1 - 1e-9) * real) << name << " of the law " << law;
        EXPECT_LE(least, 3 * real) << name << " of the law " << law;
      }
    }
}

TEST_F(Textures, SayWhatIsTooFineForTheRateOrTheDevice) {
  const auto remarks = [&](const char* wavelength, const SceneTiming& timing) {
    const auto scene = test::scene_with(fmt::format(
        R"({{"kind": "plane", "point": 0, "normal": [0, 0, 1], "stiffness": 1000,
             "texture": {{"kind": "perlin", "amplitude": 1e-4, "wavelength": {}}}}})",
        wavelength));
    scene->prepare(timing);
    return testing::PrintToString(scene->object(0).surface().remarks());
  };
  EXPECT_THAT(remarks("2e-3", {}), testing::Not(HasSubstr("texture")));
  EXPECT_THAT(remarks("4e-4", {}), HasSubstr("fades above 80 mm/s"));
  EXPECT_THAT(remarks("2e-3", {.resolution = 6e-4}), HasSubstr("too fine for the device"));
}

/// Returns the power of the height along x at a number of frequencies [1/m], by averaged periodograms.
std::vector<double> spectrum(const Height& height, std::span<const double> frequencies, double length, int lines) {
  std::vector<double> power(frequencies.size(), 0);
  constexpr int kPoints = 2048;
  for (int line = 0; line < lines; ++line) {
    std::vector<double> row(kPoints);
    for (int i = 0; i < kPoints; ++i)
      row[static_cast<std::size_t>(i)] = height.at(Vec3(length * i / kPoints, 0.137 * line, 0.071 * line), 0).value *
                                         std::pow(std::sin(pi * (i + 0.5) / kPoints), 2);
    for (std::size_t k = 0; k < frequencies.size(); ++k) {
      double a = 0, b = 0;
      for (int i = 0; i < kPoints; ++i) {
        const double angle = 2 * pi * frequencies[k] * length * i / kPoints;
        a += row[static_cast<std::size_t>(i)] * std::cos(angle);
        b += row[static_cast<std::size_t>(i)] * std::sin(angle);
      }
      power[k] += (a * a + b * b) / lines;
    }
  }
  return power;
}

double slope_of(std::span<const double> x, std::span<const double> y) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double a = std::log(x[i]), b = std::log(y[i]);
    sx += a, sy += b, sxx += a * a, sxy += a * b;
  }
  const double n = static_cast<double>(x.size());
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

TEST(PerlinNoise, IsZeroAtLatticePointsAndLimitedInHeightAndBand) {
  std::mt19937 random(2);
  double most = 0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 corner =
        Vec3(static_cast<double>(random() % 2000) - 1000, static_cast<double>(random() % 2000) - 1000, 5);
    EXPECT_EQ(perlin_noise(corner, 7).value, 0);
    most = std::max(most, std::abs(perlin_noise(corner + Vec3(0.43, 0.51, 0.37), 7).value));
  }
  EXPECT_GT(most, 0.5);
  EXPECT_LE(most, 1);
  // Most of the power along a line lies between 0.1 and 1.5 cycles per step.
  const PerlinHeight height({.amplitude = 1, .wavelength = 1, .seed = 3});
  std::vector<double> frequencies;
  for (double f = 0.02; f < 5; f += 0.02) frequencies.push_back(f);
  const std::vector<double> power = spectrum(height, frequencies, 64, 20);
  double inside = 0, all = 0;
  for (std::size_t i = 0; i < power.size(); ++i) {
    all += power[i];
    if (frequencies[i] > 0.1 && frequencies[i] < 1.5) inside += power[i];
  }
  EXPECT_GT(inside / all, 0.85);
}

TEST(FractalNoise, HasTheSpectrumOfItsExponent) {
  const FractalHeight height({.amplitude = 1, .wavelength = 1, .seed = 4}, FractalKind::fbm, 8, 0.5);
  std::vector<double> frequencies;
  for (double f = 1; f < 40; f *= 1.1) frequencies.push_back(f);
  EXPECT_NEAR(slope_of(frequencies, spectrum(height, frequencies, 16, 60)), -(2 * 0.5 + 1), 0.25);
}

TEST(PinkNoise, FallsWithOneOverTheFrequency) {
  std::vector<double> frequencies, power;
  for (double f = 80; f < 400; f *= 1.15) frequencies.push_back(f);
  power.assign(frequencies.size(), 0);
  double squares = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const WaveHeight height = WaveHeight::pink(1e-4, 2e-2, 5e-4, 64, seed);
    const std::vector<double> one = spectrum(height, frequencies, 0.2, 4);
    for (std::size_t i = 0; i < one.size(); ++i) power[i] += one[i];
    for (int i = 0; i < 500; ++i) squares += std::pow(height.at(Vec3(0.013 * i, 0.007 * i, 0), 0).value, 2) / 20'000;
  }
  EXPECT_NEAR(slope_of(frequencies, power), -1, 0.3);
  EXPECT_NEAR(std::sqrt(squares), 1e-4, 1e-5);
}

TEST(CellularNoise, HasTheDistancesOfAPoissonProcess) {
  const CellularHeight height({.amplitude = 1, .wavelength = 1, .seed = 5}, CellularKind::f1, 27);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> side(-300, 300);
  double sum = 0;
  int beyond = 0;
  constexpr int kPlaces = 20'000;
  for (int i = 0; i < kPlaces; ++i) {
    const double distance = height.at(Vec3(side(random), side(random), side(random)), 0).value;
    sum += distance;
    beyond += distance > 0.6 ? 1 : 0;
  }
  EXPECT_NEAR(sum / kPlaces, 0.554, 0.01);
  EXPECT_NEAR(static_cast<double>(beyond) / kPlaces, std::exp(-4.0 / 3 * pi * std::pow(0.6, 3)), 0.015);
}

TEST(SpotNoise, HasTheVarianceOfCampbellsTheorem) {
  constexpr double kDensity = 3;
  const SpotHeight height({.amplitude = 1, .wavelength = 1, .seed = 7}, kDensity);
  std::mt19937 random(8);
  std::uniform_real_distribution<double> side(-300, 300);
  double squares = 0, sum = 0;
  constexpr int kPlaces = 100'000;
  for (int i = 0; i < kPlaces; ++i) {
    const double value = height.at(Vec3(side(random), side(random), side(random)), 0).value;
    squares += value * value / kPlaces;
    sum += value / kPlaces;
  }
  double integral = 0;  // of the squared spot over space
  for (double r = 5e-5; r < 0.5; r += 1e-4)
    integral += 4 * pi * r * r * std::pow(0.5 * (1 + std::cos(2 * pi * r)), 2) * 1e-4;
  EXPECT_NEAR(squares - sum * sum, kDensity * integral, 0.03 * kDensity * integral);
  EXPECT_NEAR(sum, 0, 0.01);
}

TEST(ReactionDiffusion, GrowsAPatternOfOneWavelengthAndTheSameForASeed) {
  const HeightGrid grid = reaction_diffusion(96, 3000, 0.037, 0.06, 1);
  EXPECT_EQ(grid.values, reaction_diffusion(96, 3000, 0.037, 0.06, 1).values);
  EXPECT_NE(grid.values, reaction_diffusion(96, 3000, 0.037, 0.06, 2).values);
  // Power by frequency over all rows: the pattern's stripes are 8 to 16 points apart.
  std::vector<double> power(48, 0);
  for (int row = 0; row < grid.rows; ++row)
    for (std::size_t k = 1; k < power.size(); ++k) {
      double a = 0, b = 0;
      for (int i = 0; i < grid.columns; ++i) {
        a += grid.at(i, row) * std::cos(2 * pi * static_cast<double>(k) * i / grid.columns);
        b += grid.at(i, row) * std::sin(2 * pi * static_cast<double>(k) * i / grid.columns);
      }
      power[k] += a * a + b * b;
    }
  const auto peak = std::max_element(power.begin(), power.end()) - power.begin();
  EXPECT_GE(96.0 / static_cast<double>(peak), 7);
  EXPECT_LE(96.0 / static_cast<double>(peak), 20);
}

TEST(Mappings, PutAWaveOfAnImageOnPlaneCylinderSphereAndCube) {
  constexpr int kSide = 256;
  HeightGrid grid{kSide, 1, {}};
  for (int i = 0; i < kSide; ++i) grid.values.push_back(static_cast<float>(std::cos(2 * pi * i / kSide)));
  const auto expect_wave = [&](const Mapping& mapping, const Vec3& place, double u, const Vec3& du) {
    const GridHeight height(grid, mapping, 1e-4);
    const HeightSample sample = height.at(place, 0);
    EXPECT_NEAR(sample.value, 1e-4 * std::cos(2 * pi * u), 1e-9);
    EXPECT_LT((sample.gradient + 1e-4 * 2 * pi * std::sin(2 * pi * u) * du).norm(), 2e-4 * 2 * pi * 1e-4 * du.norm());
  };
  expect_wave({.kind = MappingKind::plane, .size = 0.02}, {0.003, 0.001, 5}, 0.15, Vec3(50, 0, 0));
  const double angle = 0.7;
  expect_wave({.kind = MappingKind::cylinder, .repeat = 3}, {0.03 * std::cos(angle), 0.03 * std::sin(angle), 0.1},
              3 * angle / (2 * pi), 3 / (2 * pi * 0.03) * Vec3(-std::sin(angle), std::cos(angle), 0));
  expect_wave({.kind = MappingKind::sphere, .repeat = 2}, {0.03 * std::cos(angle), 0.03 * std::sin(angle), 0.01},
              2 * angle / (2 * pi), 2 / (2 * pi * 0.03) * Vec3(-std::sin(angle), std::cos(angle), 0));
  expect_wave({.kind = MappingKind::cube}, {0.01, 0.004, 0.003}, 0.5 * (0.4 + 1),
              Vec3(-0.5 * 0.004 / 1e-4, 0.5 / 0.01, 0));
}

TEST(GreyImages, AreReadAsTheyAreStored) {
  const TempFolder folder;
  const GreyImage text = load_grey_image(folder.write("text.pgm", pgm_of_waves(65535)));
  EXPECT_EQ(text.columns, 32);
  EXPECT_EQ(text.rows, 32);
  EXPECT_NEAR(text.values[8 * 32 + 0], 1, 1e-4) << "a crest in row 8";
  const GreyImage binary = load_grey_image(
      folder.write("binary.pgm", std::string("P5 3 2 255\n") + std::string("\x00\x80\xff\x01\x02\x03", 6)));
  EXPECT_EQ(binary.values, (std::vector<float>{0, 128 / 255.0F, 1, 1 / 255.0F, 2 / 255.0F, 3 / 255.0F}));
  const GreyImage wide =
      load_grey_image(folder.write("wide.pgm", std::string("P5 1 2 65535\n") + std::string("\x12\x34\xff\xff", 4)));
  EXPECT_EQ(wide.values, (std::vector<float>{0x1234 / 65535.0F, 1}));

  // Python's zlib makes a PNG, of 16 and of 8 bits and of colours.
  const std::string script = folder.write("png.py", R"(
import struct, sys, zlib
def png(name, depth, kind, width, rows):
    def chunk(tag, data): return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))
    raw = b"".join(b"\0" + row for row in rows)
    open(name, "wb").write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), depth, kind, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))
folder = sys.argv[1] + "/"
png(folder + "deep.png", 16, 0, 2, [b"\x00\x00\x12\x34", b"\xff\xff\x80\x00"])
png(folder + "flat.png", 8, 0, 2, [b"\x00\xff"])
png(folder + "colour.png", 8, 2, 2, [b"\xff\xff\xff\x00\x00\x00"])
)");
  ASSERT_EQ(std::system(fmt::format("python3 {} {}", script, folder.path()).c_str()), 0);
  EXPECT_EQ(load_grey_image(folder / "deep.png").values,
            (std::vector<float>{0, 0x1234 / 65535.0F, 1, 0x8000 / 65535.0F}));
  EXPECT_EQ(load_grey_image(folder / "flat.png").values, (std::vector<float>{0, 1}));
  EXPECT_EQ(load_grey_image(folder / "colour.png").values, (std::vector<float>{1, 0}));
}

TEST(GreyImages, AreRefusedWithTheReasonWhenTheyAreBroken) {
  const TempFolder folder;
  const auto error = [&](const std::string& content) {
    return error_of([&] { load_grey_image(folder.write("broken", content)); });
  };
  EXPECT_THAT(error_of([&] { load_grey_image(folder / "none.png"); }), HasSubstr("none.png: cannot be read"));
  EXPECT_THAT(error("GIF89a"), HasSubstr("broken: is neither a PNG nor a PGM"));
  EXPECT_THAT(error("\x89PNG\r\n\x1a\n rubbish"), HasSubstr("is no valid PNG"));
  EXPECT_THAT(error("P5 2 2 255\nabc"), HasSubstr("ends at pixel 3 of 4"));
  EXPECT_THAT(error("P2 2 2 255\n1 2 3"), HasSubstr("pixel 3 of 4 is missing"));
  EXPECT_THAT(error("P2 2 2 9\n1 2 3 10"), HasSubstr("pixel 3 is 10, above the largest value 9"));
  EXPECT_THAT(error("P5 0 2 255\n"), HasSubstr("has no pixels"));
  EXPECT_THAT(error("P5 100000 100000 255\n"), HasSubstr("the most is"));
  EXPECT_THAT(error("P5 x"), HasSubstr("does not state"));
  // A whole PNG, cut at every length, and with every byte changed: refused or read, never a crash.
  std::mt19937 random(9);
  const std::string whole = [&] {
    const std::string script = folder.write("one.py", R"(
import struct, sys, zlib
def chunk(tag, data): return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))
open(sys.argv[1], "wb").write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 8, 8, 0, 0, 0, 0))
    + chunk(b"IDAT", zlib.compress(b"".join(b"\0" + bytes(range(8)) for _ in range(8)))) + chunk(b"IEND", b""))
)");
    EXPECT_EQ(std::system(fmt::format("python3 {} {}", script, folder / "one.png").c_str()), 0);
    std::ifstream stream(folder / "one.png", std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  }();
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string changed = whole;
    changed[i] = static_cast<char>(random());
    for (const std::string& content : {whole.substr(0, i), changed}) try {
        (void)load_grey_image(folder.write("broken", content));
      } catch (const Error&) {
      }
  }
}

}  // namespace
}  // namespace haptrace
