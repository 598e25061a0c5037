#include "scene/surface/texture/texture.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "formats/image/grey_image.h"
#include "scene/surface/texture/expression_height.h"
#include "scene/surface/texture/grid_height.h"
#include "scene/surface/texture/noise.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <numbers>
#include <string>
#include <vector>

namespace haptrace {
namespace {

constexpr double kMostHeight = 0.1, kMostWave = 10, kLeastWave = 1e-6;  // [m]
constexpr EnumNames<TextureLaw, 2> kLaws{"law", {"potential", "bump"}};

NoiseSpec read_noise(JsonReader& reader) {
  return {.amplitude = reader.require("amplitude").number("amplitude", 0, 0, kMostHeight),
          .wavelength = reader.require("wavelength").number("wavelength", 0, kLeastWave, kMostWave),
          .seed = static_cast<std::uint64_t>(reader.integer("seed", 0, 0, 1'000'000'000))};
}

std::unique_ptr<Height> read_perlin(JsonReader& reader, SceneFiles&) {
  return std::make_unique<PerlinHeight>(read_noise(reader));
}

std::unique_ptr<Height> read_fractal(JsonReader& reader, SceneFiles&) {
  const NoiseSpec noise = read_noise(reader);
  const std::array<std::string, 3> kinds{"fbm", "ridged", "turbulence"};
  const std::string word = reader.choice("sum", "fbm", kinds);
  const auto kind = static_cast<FractalKind>(std::find(kinds.begin(), kinds.end(), word) - kinds.begin());
  const int octaves = reader.integer("octaves", 4, 1, FractalHeight::kMostOctaves);
  return std::make_unique<FractalHeight>(noise, kind, octaves, reader.number("hurst", 0.8, 0, 2));
}

std::unique_ptr<Height> read_spots(JsonReader& reader, SceneFiles&) {
  const NoiseSpec noise = read_noise(reader);
  return std::make_unique<SpotHeight>(noise, reader.number("density", 2, 0.01, 20));
}

std::unique_ptr<Height> read_cellular(JsonReader& reader, SceneFiles&) {
  const NoiseSpec noise = read_noise(reader);
  const std::array<std::string, 2> kinds{"f1", "f2-f1"};
  const auto kind = reader.choice("distance", "f1", kinds) == "f1" ? CellularKind::f1 : CellularKind::f2_minus_f1;
  return std::make_unique<CellularHeight>(noise, kind, reader.integer("cells", 27, 8, 27));
}

std::unique_ptr<Height> read_fourier(JsonReader& reader, SceneFiles&) {
  std::vector<WaveHeight::Wave> waves;
  for (JsonReader& wave : reader.require("waves").objects("waves")) {
    const double wavelength = wave.require("wavelength").number("wavelength", 0, kLeastWave, kMostWave);
    const Vec3 direction = wave.vector("direction", Vec3::UnitX(), -1e6, 1e6);
    if (!(direction.stableNorm() > 1e-6)) throw input_error(wave.where() + ".direction: the vector has no direction");
    waves.push_back({.number = 2 * std::numbers::pi / wavelength * direction.stableNormalized(),
                     .amplitude = wave.require("amplitude").number("amplitude", 0, -kMostHeight, kMostHeight),
                     .phase = wave.number("phase", 0, -1e3, 1e3)});
    wave.finish();
  }
  constexpr std::size_t kMostWaves = 256;
  if (waves.empty() || waves.size() > kMostWaves)
    throw input_error(
        fmt::format("{}.waves: there are {} waves; 1 to {} are possible", reader.where(), waves.size(), kMostWaves));
  return std::make_unique<WaveHeight>(std::move(waves));
}

std::unique_ptr<Height> read_pink(JsonReader& reader, SceneFiles&) {
  const double rms = reader.require("amplitude").number("amplitude", 0, 0, kMostHeight);
  const double longest = reader.require("wavelength").number("wavelength", 0, kLeastWave, kMostWave);
  const double shortest = reader.number("shortest", longest / 16, kLeastWave, longest);
  const int waves = reader.integer("waves", 24, 1, 256);
  const auto seed = static_cast<std::uint64_t>(reader.integer("seed", 0, 0, 1'000'000'000));
  return std::make_unique<WaveHeight>(WaveHeight::pink(rms, longest, shortest, waves, seed));
}

Mapping mapping_of(JsonReader& reader) {
  std::optional<JsonReader> mapping = reader.object("mapping");
  return mapping ? read_mapping(std::move(*mapping)) : Mapping{};
}

/// Makes the height of a grid with its accuracy settings.
std::unique_ptr<Height> grid_height(JsonReader& reader, HeightGrid grid) {
  const int all = std::max(grid.columns, grid.rows);
  const Mapping mapping = mapping_of(reader);
  auto height = std::make_unique<GridHeight>(std::move(grid), mapping,
                                             reader.require("amplitude").number("amplitude", 0, 0, kMostHeight));
  const int order = reader.integer("order", 3, 1, 3);
  if (order == 2) throw input_error(reader.where() + ".order: 2 is not known; known: 1, 3");
  height->set("order", order);
  height->set("texels", reader.integer("texels", all, 1, all));
  return height;
}

std::unique_ptr<Height> read_image(JsonReader& reader, SceneFiles& files) {
  const GreyImage image = load_grey_image(files.find(reader.require("file").text("file", "")));
  HeightGrid grid{image.columns, image.rows, image.values};
  for (float& value : grid.values) value = 2 * value - 1;
  return grid_height(reader, std::move(grid));
}

std::unique_ptr<Height> read_reaction(JsonReader& reader, SceneFiles&) {
  const int side = reader.integer("side", 128, 16, 1024);
  const int steps = reader.integer("steps", 4000, 0, 100'000);
  const double feed = reader.number("feed", 0.037, 0, 0.1), kill = reader.number("kill", 0.06, 0, 0.1);
  const auto seed = static_cast<std::uint64_t>(reader.integer("seed", 1, 0, 1'000'000'000));
  return grid_height(reader, reaction_diffusion(side, steps, feed, kill, seed));
}

std::unique_ptr<Height> read_expression(JsonReader& reader, SceneFiles&) {
  constexpr std::array<std::string_view, 2> kVariables{"u", "v"};
  const std::string text = reader.require("height").text("height", "");
  const double wavelength = reader.require("wavelength").number("wavelength", 0, kLeastWave, kMostWave);
  const Mapping mapping = mapping_of(reader);
  try {
    return std::make_unique<ExpressionHeight>(Expression(text, kVariables), mapping, wavelength, kMostHeight);
  } catch (const Error& error) {
    throw input_error(reader.where() + ".height: " + error.what());
  }
}

/// One kind of texture. A new kind needs only an entry in the list below.
struct TextureKind {
  const char* kind;
  std::unique_ptr<Height> (*read)(JsonReader& reader, SceneFiles& files);
};

constexpr std::array kTextureKinds{
    TextureKind{"perlin", read_perlin},         TextureKind{"fractal", read_fractal},
    TextureKind{"fourier", read_fourier},       TextureKind{"pink", read_pink},
    TextureKind{"spots", read_spots},           TextureKind{"cellular", read_cellular},
    TextureKind{"image", read_image},           TextureKind{"reaction-diffusion", read_reaction},
    TextureKind{"expression", read_expression},
};

}  // namespace

Texture read_texture(JsonReader reader, SceneFiles& files) {
  std::vector<std::string> known;
  for (const TextureKind& kind : kTextureKinds) known.emplace_back(kind.kind);
  const std::string word = reader.require("kind").choice("kind", "", known);
  const auto kind =
      std::find_if(kTextureKinds.begin(), kTextureKinds.end(), [&](const auto& entry) { return entry.kind == word; });
  Texture texture;
  texture.height = kind->read(reader, files);
  const std::array<std::string, 2> laws{"potential", "bump"};
  texture.law = kLaws.parse(reader.choice("law", "potential", laws));
  reader.finish();
  return texture;
}

}  // namespace haptrace
