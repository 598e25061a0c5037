#include "formats/mesh/mesh_file.h"

#include "base/error.h"
#include "base/number.h"
#include "base/text_file.h"
#include "base/units.h"
#include "formats/mesh/polygon.h"
#include "formats/reader_process.h"

#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <assimp/scene.h>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <limits>
#include <numbers>
#include <span>
#include <unordered_map>

namespace haptrace {
namespace {

constexpr std::uintmax_t kLargestFile = std::uintmax_t{4} << 30U;
constexpr double kHuge = 3, kTiny = 1e-3;  // sizes that suggest another unit [m]

/// Adds a polygon, whose corners are indices of the mesh's vertices.
void add_polygon(std::span<const std::uint32_t> corners, const std::string& file, TriangleMesh& mesh) {
  constexpr std::size_t kMostCorners = 10'000;
  if (corners.size() > kMostCorners)
    throw input_error(fmt::format("{}: a face has {} corners; at most {} are possible. Split it", file, corners.size(),
                                  kMostCorners));
  if (corners.size() == 3) {
    mesh.triangles.push_back({corners[0], corners[1], corners[2]});
    return;
  }
  std::vector<Vec3> places;
  places.reserve(corners.size());
  for (const std::uint32_t corner : corners) places.push_back(mesh.vertices[corner]);
  for (const auto& t : triangles_of(places)) mesh.triangles.push_back({corners[t[0]], corners[t[1]], corners[t[2]]});
}

/// Takes the first word off a line.
std::string_view taken(std::string_view& line) {
  line = trim(line);
  const std::string_view word = line.substr(0, line.find_first_of(" \t"));
  line.remove_prefix(word.size());
  return word;
}

/// Reads the vertices and faces of an OBJ file; nothing else in it has a place.
TriangleMesh load_obj(const std::string& file) {
  LineReader lines(file, "an OBJ file");
  TriangleMesh mesh;
  struct Face {
    std::size_t line, first;  // the number of its line; of `corners`
  };
  std::vector<Face> faces;
  std::vector<std::int64_t> corners;  // vertices from 0, which may follow later in the file
  std::string joined;
  for (std::string_view line; lines.next(line);) {
    line = trim(line);
    if (line.ends_with('\\')) {  // continues in the next line
      joined.append(line.substr(0, line.size() - 1)).push_back(' ');
      continue;
    }
    if (!joined.empty()) line = joined.append(line);
    const std::string_view kind = taken(line);
    if (kind == "v") {
      Vec3 place;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = taken(line);
        if (!parse_number(word, place[axis]) || !std::isfinite(place[axis]))
          throw lines.error(fmt::format("'{}' is no coordinate of a vertex", shown(word)));
      }
      mesh.vertices.push_back(place);
    } else if (kind == "f") {
      faces.push_back({lines.number(), corners.size()});
      for (std::string_view word = taken(line); !word.empty() && word[0] != '#'; word = taken(line)) {
        const std::string_view number = word.substr(0, word.find('/'));
        const std::int64_t index = number_of<std::int64_t>(number).value_or(0);
        if (index == 0) throw lines.error(fmt::format("'{}' is no vertex of a face", shown(word)));
        corners.push_back(index > 0 ? index - 1 : static_cast<std::int64_t>(mesh.vertices.size()) + index);
      }
    }
    joined.clear();
  }
  if (!joined.empty()) throw lines.error("the line continues, but the file ends");
  const auto count = static_cast<std::int64_t>(mesh.vertices.size());
  std::vector<std::uint32_t> polygon;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    polygon.clear();
    for (std::size_t i = faces[f].first; i < (f + 1 < faces.size() ? faces[f + 1].first : corners.size()); ++i) {
      if (corners[i] < 0 || corners[i] >= count)
        throw input_error(fmt::format("{}:{}: the face names vertex {}, but there are {}", file, faces[f].line,
                                      corners[i] + 1, count));
      polygon.push_back(static_cast<std::uint32_t>(corners[i]));
    }
    add_polygon(polygon, file, mesh);
  }
  return mesh;
}

/// Adds the meshes of a node and its children.
void add_node(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, int depth, TriangleMesh& mesh,
              const std::string& file) {
  constexpr int kDeepest = 200;
  if (depth > kDeepest) throw input_error(file + ": its parts are nested more than 200 levels deep");
  const aiMatrix4x4 placed = parent * node.mTransformation;
  const bool mirrored = placed.Determinant() < 0;  // what was wound outwards is now wound inwards
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    const aiMesh& part = *scene.mMeshes[node.mMeshes[m]];
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    if (mesh.vertices.size() + part.mNumVertices > 3 * kMostMeshTriangles)
      throw input_error(fmt::format("{}: has more than {} vertices", file, 3 * kMostMeshTriangles));
    for (unsigned i = 0; i < part.mNumVertices; ++i) {
      const aiVector3D v = placed * part.mVertices[i];
      mesh.vertices.emplace_back(v.x, v.y, v.z);
    }
    std::vector<std::uint32_t> polygon;
    for (unsigned i = 0; i < part.mNumFaces; ++i) {
      const aiFace& face = part.mFaces[i];
      polygon.clear();
      for (unsigned k = 0; k < face.mNumIndices; ++k) {
        if (face.mIndices[k] >= part.mNumVertices)
          throw input_error(fmt::format("{}: face {} names vertex {}, but there are {}", file, i, face.mIndices[k],
                                        part.mNumVertices));
        polygon.push_back(first + face.mIndices[k]);
      }
      if (mirrored) std::reverse(polygon.begin(), polygon.end());
      add_polygon(polygon, file, mesh);
    }
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i) add_node(scene, *node.mChildren[i], placed, depth + 1, mesh, file);
}

TriangleMesh load_with_assimp(const std::string& file) {
  Assimp::Importer importer;
  const aiScene* const scene = importer.ReadFile(file, 0);
  if (scene == nullptr || scene->mRootNode == nullptr)
    throw input_error(fmt::format("{}: cannot be read as a mesh (OBJ, STL, PLY, glTF): {}", file,
                                  shown(trim(importer.GetErrorString()))));
  TriangleMesh mesh;
  add_node(*scene, *scene->mRootNode, aiMatrix4x4(), 0, mesh, file);
  return mesh;
}

/// Returns a mesh as bytes: the numbers of vertices and triangles, and both.
std::string packed(const TriangleMesh& mesh) {
  static_assert(sizeof(Vec3) == 3 * sizeof(double));
  const std::array<std::uint64_t, 2> counts{mesh.vertices.size(), mesh.triangles.size()};
  const std::size_t of_vertices = mesh.vertices.size() * sizeof(Vec3),
                    of_triangles = mesh.triangles.size() * sizeof mesh.triangles[0];
  std::string bytes(sizeof counts + of_vertices + of_triangles, '\0');
  std::memcpy(bytes.data(), counts.data(), sizeof counts);
  if (of_vertices > 0)
    std::memcpy(bytes.data() + sizeof counts, static_cast<const void*>(mesh.vertices.data()), of_vertices);
  if (of_triangles > 0) std::memcpy(bytes.data() + sizeof counts + of_vertices, mesh.triangles.data(), of_triangles);
  return bytes;
}

/// Returns the mesh of bytes from packed().
TriangleMesh unpacked(const std::string& bytes) {
  std::array<std::uint64_t, 2> counts{};
  std::memcpy(counts.data(), bytes.data(), sizeof counts);
  TriangleMesh mesh;
  mesh.vertices.resize(counts[0]);
  mesh.triangles.resize(counts[1]);
  const std::size_t of_vertices = counts[0] * sizeof(Vec3), of_triangles = counts[1] * sizeof mesh.triangles[0];
  const char* const values = bytes.data() + sizeof counts;
  if (of_vertices > 0) std::memcpy(static_cast<void*>(mesh.vertices.data()), values, of_vertices);
  if (of_triangles > 0) std::memcpy(mesh.triangles.data(), values + of_vertices, of_triangles);
  return mesh;
}

/// Returns the fewest bytes of a property of a PLY file: in text a digit and a separator.
std::uint64_t least_bytes_of_property(std::string_view line, bool text) {
  if (text) return 2;
  std::string_view type = trim(line.substr(std::string_view("property").size()));
  if (type.starts_with("list ")) type = trim(type.substr(5));  // at least its length
  type = type.substr(0, type.find(' '));
  for (const auto& [name, bytes] : {std::pair{"char", 1},
                                    {"uchar", 1},
                                    {"int8", 1},
                                    {"uint8", 1},
                                    {"short", 2},
                                    {"ushort", 2},
                                    {"int16", 2},
                                    {"uint16", 2},
                                    {"double", 8},
                                    {"float64", 8}})
    if (type == name) return static_cast<std::uint64_t>(bytes);
  return 4;
}

/// Throws Error(input) if a PLY file is shorter than its header promises. Any other file passes: assimp judges it.
void check_length_of_ply(const std::string& file) {
  constexpr std::size_t kMostLines = 1000, kMostLine = 4096;
  constexpr std::uint64_t kMostElements = 1ULL << 40U;
  std::ifstream stream(file, std::ios::binary);
  std::string promised, line(kMostLine, '\0');
  std::uint64_t needed = 0, count = 0;
  bool text = true, ended = false;
  for (std::size_t i = 0; i < kMostLines && !ended; ++i) {
    if (!stream.getline(line.data(), static_cast<std::streamsize>(line.size()))) return;
    const std::string_view word = trim(std::string_view(line.c_str()));
    if (i == 0 && word != "ply") return;
    if (word.starts_with("format")) text = word.find("ascii") != std::string_view::npos;
    if (word.starts_with("element ")) {
      const std::size_t space = word.rfind(' ');
      const auto number = number_of<std::uint64_t>(word.substr(space + 1));
      count = number ? std::min(*number, kMostElements) : 0;
      promised +=
          fmt::format("{}{} {}", promised.empty() ? "" : ", ", word.substr(space + 1), word.substr(8, space - 8));
    }
    if (word.starts_with("property ")) needed += count * least_bytes_of_property(word, text);
    ended = word == "end_header";
  }
  if (!ended) return;
  const auto begin = static_cast<std::uint64_t>(std::max<std::streamoff>(0, stream.tellg()));
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(file, error);
  // The last separator of a text may be absent.
  if (error || begin + needed <= size + 1) return;
  throw input_error(
      fmt::format("{}: is shorter than its header promises: {} need at least {} bytes, but {} follow; is it complete?",
                  file, promised, needed, size - std::min(size, begin)));
}

/// Throws Error(input) if a binary STL file is shorter than the triangles it promises. Any other file passes.
void check_length_of_stl(const std::string& file) {
  constexpr std::uint64_t kHead = 84, kTriangle = 50;  // [bytes]
  std::array<char, kHead> head{};
  std::ifstream stream(file, std::ios::binary);
  if (file_ending(file) != ".stl" || !stream.read(head.data(), head.size())) return;
  if (std::string_view(head.data(), head.size()).starts_with("solid")) return;  // text, which assimp judges
  std::uint32_t promised = 0;
  std::memcpy(&promised, head.data() + head.size() - sizeof promised, sizeof promised);
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(file, error);
  if (error || kHead + kTriangle * promised <= size) return;
  throw input_error(fmt::format("{}: promises {} triangles, but ends after {}; is it complete?", file, promised,
                                (size - kHead) / kTriangle));
}

/// Reads a file in a process of its own: assimp ends the process at some broken files.
TriangleMesh load_other(const std::string& file) {
  check_length_of_ply(file);
  check_length_of_stl(file);
  constexpr ReaderLimits kLimits{
      .memory = 256U << 20U, .memory_per_byte = 100, .seconds = 2, .bytes_per_second = 2'000'000};
  return unpacked(read_in_process(file, "a mesh", kLimits, [&] { return packed(load_with_assimp(file)); }));
}

/// Makes one vertex of those at the same place.
void weld(TriangleMesh& mesh) {
  struct Hash {
    std::size_t operator()(const std::array<std::uint64_t, 3>& key) const noexcept {
      std::uint64_t hash = 0;
      for (std::uint64_t part : key) {
        part *= 0x9e3779b97f4a7c15;
        hash = (hash ^ part ^ (part >> 29U)) * 0xbf58476d1ce4e5b9;
      }
      return static_cast<std::size_t>(hash ^ (hash >> 32U));
    }
  };
  std::unordered_map<std::array<std::uint64_t, 3>, std::uint32_t, Hash> known;
  known.reserve(mesh.vertices.size());
  std::vector<std::uint32_t> index(mesh.vertices.size());
  std::vector<Vec3> kept;
  kept.reserve(mesh.vertices.size());
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vec3 place = mesh.vertices[i] + Vec3::Zero();  // -0 becomes 0
    const std::array key{std::bit_cast<std::uint64_t>(place.x()), std::bit_cast<std::uint64_t>(place.y()),
                         std::bit_cast<std::uint64_t>(place.z())};
    const auto [found, added] = known.emplace(key, static_cast<std::uint32_t>(kept.size()));
    if (added) kept.push_back(place);
    index[i] = found->second;
  }
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& corner : triangle) corner = index[corner];
  mesh.vertices = std::move(kept);
}

/// Joins of triangles at their edges.
struct Joins {
  struct Edge {
    std::uint64_t key;
    std::uint32_t triangle;
    std::uint8_t corner;
    bool forwards;
  };
  explicit Joins(const TriangleMesh& mesh) {
    edges.reserve(3 * mesh.triangles.size());
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
      for (std::uint8_t i = 0; i < 3; ++i) {
        const std::uint32_t a = mesh.triangles[t][i], b = mesh.triangles[t][(i + 1U) % 3];
        edges.push_back({(static_cast<std::uint64_t>(std::min(a, b)) << 32U) | std::max(a, b), t, i, a < b});
      }
    std::sort(edges.begin(), edges.end(),
              [](const Edge& a, const Edge& b) { return a.key != b.key ? a.key < b.key : a.triangle < b.triangle; });
  }
  template <class Visit>
  void each(const Visit& visit) const {
    for (std::size_t i = 0; i < edges.size();) {
      std::size_t end = i + 1;
      while (end < edges.size() && edges[end].key == edges[i].key) ++end;
      visit(&edges[i], end - i);
      i = end;
    }
  }
  std::vector<Edge> edges;
};

/// The parts of a mesh that no edge joins.
struct Parts {
  std::vector<std::uint32_t> of;       ///< the part of every triangle
  std::vector<std::uint32_t> at_open;  ///< triangles at open edges
};

/// The neighbours of every triangle, over the edges that two triangles share.
class Neighbours {
 public:
  struct Neighbour {
    std::uint32_t triangle;
    bool agrees;  ///< on the outside
  };

  Neighbours(const Joins& joins, std::size_t triangles) : first_(triangles + 1, 0) {
    joins.each([&](const Joins::Edge* edge, std::size_t number) {
      if (number != 2) return;
      ++first_[edge[0].triangle + 1];
      ++first_[edge[1].triangle + 1];
    });
    for (std::size_t t = 0; t < triangles; ++t) first_[t + 1] += first_[t];
    list_.resize(first_.back());
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    joins.each([&](const Joins::Edge* edge, std::size_t number) {
      if (number != 2) return;
      const bool agrees = edge[0].forwards != edge[1].forwards;
      list_[next[edge[0].triangle]++] = {edge[1].triangle, agrees};
      list_[next[edge[1].triangle]++] = {edge[0].triangle, agrees};
    });
  }

  [[nodiscard]] std::span<const Neighbour> of(std::uint32_t triangle) const {
    return std::span(list_).subspan(first_[triangle], first_[triangle + 1] - first_[triangle]);
  }

 private:
  std::vector<std::uint32_t> first_;  ///< in the list, of every triangle
  std::vector<Neighbour> list_;
};

/// Counts the edges that one triangle has alone, and those that more than two share. Returns the triangles at the first
/// ones.
std::vector<std::uint32_t> count_edges(const Joins& joins, const TriangleMesh& mesh, MeshReport& report) {
  std::vector<std::uint32_t> at_open;
  joins.each([&](const Joins::Edge* edge, std::size_t number) {
    if (number > 2) ++report.shared_edges;
    if (number != 1) return;
    at_open.push_back(edge->triangle);
    if (report.open_edges++ > 0) return;
    const auto& t = mesh.triangles[edge->triangle];
    report.open_at = 0.5 * (mesh.vertices[t[edge->corner]] + mesh.vertices[t[(edge->corner + 1U) % 3]]);
  });
  return at_open;
}

/// Decides which triangles are to be turned over, part by part.
class PartTurns {
 public:
  enum class Turn : std::uint8_t { unknown, stays, turns };

  PartTurns(const TriangleMesh& mesh, const Neighbours& neighbours)
      : mesh_(mesh), neighbours_(neighbours), turn_(mesh.triangles.size(), Turn::unknown) {}

  [[nodiscard]] bool known(std::uint32_t triangle) const { return turn_[triangle] != Turn::unknown; }

  /// Finds the part of a triangle, and which of its triangles agree with this one. Throws Error(input) if the part has
  /// only one side.
  void spread_from(std::uint32_t seed, const std::string& name) {
    part_.assign(1, seed);
    turn_[seed] = Turn::stays;
    turning_ = 0;
    for (std::size_t i = 0; i < part_.size(); ++i) {
      const std::uint32_t t = part_[i];
      turning_ += turn_[t] == Turn::turns ? 1 : 0;
      for (const Neighbours::Neighbour& neighbour : neighbours_.of(t)) {
        const Turn wanted = neighbour.agrees == (turn_[t] == Turn::stays) ? Turn::stays : Turn::turns;
        Turn& other = turn_[neighbour.triangle];
        if (other == Turn::unknown) {
          other = wanted;
          part_.push_back(neighbour.triangle);
        } else if (other != wanted) {
          const Vec3& at = mesh_.vertices[mesh_.triangles[t][0]];
          throw input_error(
              fmt::format("{}: near ({:.4g}, {:.4g}, {:.4g}) m the triangles form a surface with only one side, like a "
                          "Moebius strip, "
                          "which has no outside",
                          name, at.x(), at.y(), at.z()));
        }
      }
    }
  }

  /// Returns the triangles of the last part.
  [[nodiscard]] std::span<const std::uint32_t> part() const { return part_; }
  /// Calls `turn` with the triangles of the last part that are to be turned over: the majority knows better.
  template <class Do>
  void each_turned(const Do& turn) const {
    const Turn flipped = 2 * turning_ > part_.size() ? Turn::stays : Turn::turns;
    for (const std::uint32_t t : part_)
      if (turn_[t] == flipped) turn(t);
  }

 private:
  const TriangleMesh& mesh_;
  const Neighbours& neighbours_;
  std::vector<Turn> turn_;
  std::vector<std::uint32_t> part_;
  std::size_t turning_ = 0;  ///< triangles of the part that do not agree with its first
};

/// Turns triangles over until neighbours agree on the outside. Throws Error(input) if they cannot.
Parts orient(TriangleMesh& mesh, MeshReport& report, const std::string& name) {
  const Joins joins(mesh);
  Parts parts{.of = std::vector<std::uint32_t>(mesh.triangles.size()), .at_open = count_edges(joins, mesh, report)};
  const Neighbours neighbours(joins, mesh.triangles.size());
  PartTurns turns(mesh, neighbours);
  for (std::uint32_t seed = 0; seed < mesh.triangles.size(); ++seed) {
    if (turns.known(seed)) continue;
    turns.spread_from(seed, name);
    for (const std::uint32_t t : turns.part()) parts.of[t] = static_cast<std::uint32_t>(report.parts);
    ++report.parts;
    turns.each_turned([&](std::uint32_t t) {
      std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
      ++report.turned;
    });
  }
  return parts;
}

/// Judges which side of each part is the outside.
class Sides {
 public:
  Sides(TriangleMesh& mesh, const Parts& parts, std::size_t count) : mesh_(mesh), of_(parts.of), parts_(count) {
    measure();
    for (const std::uint32_t t : parts.at_open) parts_[of_[t]].closed = false;
  }

  /// Turns over every closed part that is inside out and lies in no other, with all that lies inside it. So a cavity
  /// stays wound inwards.
  void turn(MeshReport& report) {
    std::vector<std::uint32_t> wrong;
    for (std::uint32_t p = 0; p < parts_.size(); ++p)
      if (parts_[p].closed && parts_[p].volume < 0) wrong.push_back(p);
    if (wrong.empty()) return;
    list_triangles();
    // Beyond this number of pairs, every part stands for itself.
    constexpr std::size_t kMostPairs = 100'000'000;
    const bool nests = wrong.size() * parts_.size() <= kMostPairs;
    std::vector<bool> turns(parts_.size(), false);
    for (const std::uint32_t p : wrong) {
      bool within = false;
      for (std::uint32_t q = 0; nests && q < parts_.size() && !within; ++q) within = inside(p, q);
      if (within) continue;
      turns[p] = true;
      for (std::uint32_t q = 0; nests && q < parts_.size(); ++q)
        if (inside(q, p)) turns[q] = true;
    }
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
      if (turns[of_[t]]) std::swap(mesh_.triangles[t][1], mesh_.triangles[t][2]);
    report.parts_turned = static_cast<std::size_t>(std::count(turns.begin(), turns.end(), true));
    report.inside_out = report.parts_turned == parts_.size();
    for (std::size_t p = 0; p < parts_.size(); ++p)
      if (turns[p]) parts_[p].volume = -parts_[p].volume;
  }

  /// Counts the open parts that are almost closed and whose faces look inwards. A sheet, a valley or a shallow bowl is
  /// none: it has no inside.
  void count_inwards(MeshReport& report) const {
    constexpr double kClearly = 0.5, kFlat = 0.6;  // of the sums of magnitudes
    for (const Part& part : parts_) {
      if (part.closed || !(part.volume < -kClearly * part.volumes) || !(part.facing.norm() < kFlat * part.area))
        continue;
      if (report.inwards++ == 0) report.inwards_at = part.first;
    }
  }

 private:
  struct Part {
    Vec3 least = Vec3::Constant(std::numeric_limits<double>::infinity()), most = -least;
    Vec3 facing = Vec3::Zero();  ///< sum of normals times areas: zero for a closed part [m^2]
    Vec3 middle = Vec3::Zero();  ///< by area [m]
    double area = 0;             ///< [m^2]
    double volume = 0;           ///< around the middle, with its sign [m^3]
    double volumes = 0;          ///< the same without signs [m^3]
    std::uint32_t first = 0xffffffff;
    bool closed = true;
  };

  [[nodiscard]] std::array<Vec3, 3> corners(std::size_t triangle, const Vec3& around) const {
    const auto& t = mesh_.triangles[triangle];
    return {mesh_.vertices[t[0]] - around, mesh_.vertices[t[1]] - around, mesh_.vertices[t[2]] - around};
  }

  void measure() {
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t) {
      Part& part = parts_[of_[t]];
      part.first = std::min(part.first, t);
      const std::array<Vec3, 3> at = corners(t, Vec3::Zero());
      for (const Vec3& corner : at) {
        part.least = part.least.cwiseMin(corner);
        part.most = part.most.cwiseMax(corner);
      }
      const Vec3 facing = 0.5 * (at[1] - at[0]).cross(at[2] - at[0]);
      const double area = facing.norm();
      part.facing += facing;
      part.area += area;
      part.middle += area / 3 * (at[0] + at[1] + at[2]);
    }
    constexpr double kRounding = 1e-9;
    for (Part& part : parts_) {
      if (part.area > 0) part.middle /= part.area;
      part.closed = part.facing.norm() <= kRounding * part.area;
    }
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      Part& part = parts_[of_[t]];
      const std::array<Vec3, 3> at = corners(t, part.middle);
      const double volume = at[0].dot(at[1].cross(at[2])) / 6;
      part.volume += volume;
      part.volumes += std::abs(volume);
    }
  }

  /// Lists the triangles of every part.
  void list_triangles() {
    begin_.assign(parts_.size() + 1, 0);
    for (const std::uint32_t p : of_) ++begin_[p + 1];
    for (std::size_t p = 0; p < parts_.size(); ++p) begin_[p + 1] += begin_[p];
    list_.resize(of_.size());
    std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
    for (std::uint32_t t = 0; t < of_.size(); ++t) list_[next[of_[t]]++] = t;
  }

  /// Returns whether part p lies inside the closed part q: by the angle under which p sees q (Van Oosterom and Strackee
  /// 1983).
  [[nodiscard]] bool inside(std::uint32_t p, std::uint32_t q) const {
    const Part &inner = parts_[p], &outer = parts_[q];
    if (p == q || !outer.closed || (inner.least.array() < outer.least.array()).any() ||
        (inner.most.array() > outer.most.array()).any())
      return false;
    const std::array<Vec3, 3> place = corners(inner.first, Vec3::Zero());
    const Vec3 from = (place[0] + place[1] + place[2]) / 3;
    double turns = 0;
    for (std::uint32_t i = begin_[q]; i < begin_[q + 1]; ++i) {
      const std::array<Vec3, 3> at = corners(list_[i], from);
      const double a = at[0].norm(), b = at[1].norm(), c = at[2].norm();
      turns += std::atan2(at[0].dot(at[1].cross(at[2])),
                          a * b * c + at[0].dot(at[1]) * c + at[1].dot(at[2]) * a + at[2].dot(at[0]) * b);
    }
    return std::abs(turns) > std::numbers::pi;  // half of 2 pi, which is a full view
  }

  TriangleMesh& mesh_;
  const std::vector<std::uint32_t>& of_;
  std::vector<Part> parts_;
  std::vector<std::uint32_t> begin_, list_;
};

double volume_of(const TriangleMesh& mesh, const Vec3& around) {
  double sum = 0;
  for (const auto& t : mesh.triangles)
    sum += (mesh.vertices[t[0]] - around).dot((mesh.vertices[t[1]] - around).cross(mesh.vertices[t[2]] - around));
  return sum / 6;
}

/// Drops vertices that no triangle uses.
void compact(TriangleMesh& mesh) {
  constexpr std::uint32_t kUnused = 0xffffffff;
  std::vector<std::uint32_t> index(mesh.vertices.size(), kUnused);
  std::vector<Vec3> kept;
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& corner : triangle) {
      if (index[corner] == kUnused) {
        index[corner] = static_cast<std::uint32_t>(kept.size());
        kept.push_back(mesh.vertices[corner]);
      }
      corner = index[corner];
    }
  mesh.vertices = std::move(kept);
}

std::vector<std::string> remarks_on(const MeshReport& report) {
  std::vector<std::string> remarks;
  const auto add = [&](std::size_t number, const std::string& text) {
    if (number > 0) remarks.push_back(text);
  };
  // States a number of triangles with the verb that fits.
  const auto triangles = [](std::size_t number, const char* one, const char* many) {
    return number == 1 ? fmt::format("1 triangle {}", one) : fmt::format("{} triangles {}", number, many);
  };
  add(report.flat,
      triangles(report.flat, "has", "have") + " no area and " + (report.flat == 1 ? "was left out" : "were left out"));
  add(report.repeated, triangles(report.repeated, "is", "are") + " there twice; one of each was left out");
  add(report.turned, triangles(report.turned, "was", "were") + " wound the other way round, and turned over");
  if (report.inside_out)
    add(1, "the mesh was inside out, and was turned over");
  else
    add(report.parts_turned,
        fmt::format("{} of {} parts {} inside out, and {} turned over", report.parts_turned, report.parts,
                    report.parts_turned == 1 ? "was" : "were", report.parts_turned == 1 ? "was" : "were"));
  add(report.inwards,
      fmt::format("{} and looks inwards, the first at triangle {}: the tool cannot touch it from outside. Turn its "
                  "faces over or close it",
                  report.inwards == 1 ? "1 part is open" : fmt::format("each of {} parts is open", report.inwards),
                  report.inwards_at + 1));
  add(report.open_edges,
      fmt::format("{} open, the first at ({:.4g}, {:.4g}, {:.4g}) m: the tool can get behind the "
                  "surface there",
                  report.open_edges == 1 ? "1 edge is" : fmt::format("{} edges are", report.open_edges),
                  report.open_at.x(), report.open_at.y(), report.open_at.z()));
  add(report.shared_edges,
      fmt::format("{} to more than two triangles: parts of the surface touch there",
                  report.shared_edges == 1 ? "1 edge belongs" : fmt::format("{} edges belong", report.shared_edges)));
  const double size = report.size.maxCoeff();
  add(size > kHuge || size < kTiny ? 1 : 0,
      fmt::format("the mesh is {:.3g} m x {:.3g} m x {:.3g} m large; is its unit right?", report.size.x(),
                  report.size.y(), report.size.z()));
  return remarks;
}

}  // namespace

MeshLoad clean_mesh(TriangleMesh mesh, const std::string& name) {
  MeshLoad load;
  MeshReport& report = load.report;
  report.vertices_in_file = mesh.vertices.size();
  report.triangles_in_file = mesh.triangles.size();
  if (mesh.triangles.empty()) throw input_error(name + ": has no triangles");
  if (mesh.triangles.size() > kMostMeshTriangles)
    throw input_error(
        fmt::format("{}: has {} triangles; the most is {}", name, mesh.triangles.size(), kMostMeshTriangles));
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i)
    if (!is_finite(mesh.vertices[i]) || !(mesh.vertices[i].cwiseAbs().maxCoeff() < 1e6))
      throw input_error(fmt::format("{}: vertex {} is not finite, or beyond 1000 km", name, i + 1));
  weld(mesh);
  report.flat = std::erase_if(mesh.triangles, [&](const auto& triangle) { return is_flat(mesh, triangle); });
  if (mesh.triangles.empty()) throw input_error(name + ": none of its triangles has an area");
  // Twice the same triangle, wherever its first corner is.
  const auto canonical = [](std::array<std::uint32_t, 3> t) {
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    return t;
  };
  {
    std::vector<std::array<std::uint32_t, 3>> sorted(mesh.triangles.size());
    std::transform(mesh.triangles.begin(), mesh.triangles.end(), sorted.begin(), canonical);
    std::sort(sorted.begin(), sorted.end());
    if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
      sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
      report.repeated = mesh.triangles.size() - sorted.size();
      mesh.triangles = std::move(sorted);
    }
  }
  compact(mesh);
  const Parts parts = orient(mesh, report, name);
  Sides sides(mesh, parts, report.parts);
  sides.turn(report);
  sides.count_inwards(report);
  Vec3 least = mesh.vertices.front(), most = least;
  for (const Vec3& vertex : mesh.vertices) {
    least = least.cwiseMin(vertex);
    most = most.cwiseMax(vertex);
  }
  report.size = most - least;
  const bool closed = report.open_edges == 0;
  if (closed) {
    report.volume = volume_of(mesh, 0.5 * (least + most));
    if (report.volume < 0) {
      report.inside_out = true;
      report.volume = -report.volume;
      for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    }
  }
  load.mesh = std::move(mesh);
  load.remarks = remarks_on(report);
  return load;
}

MeshLoad load_mesh(const std::string& file, const std::string& unit) {
  namespace fs = std::filesystem;
  const Unit* const length = find_unit(unit, "m");
  if (length == nullptr)
    throw input_error(fmt::format("{}: unit '{}' is no length; give m, mm, cm, um or in", file, unit));
  std::error_code error;
  if (!fs::is_regular_file(file, error)) throw input_error(file + ": no such file");
  if (fs::file_size(file, error) > kLargestFile) throw input_error(file + ": is larger than 4 GiB");
  TriangleMesh mesh = file_ending(file) == ".obj" ? load_obj(file) : load_other(file);
  for (Vec3& vertex : mesh.vertices) vertex /= length->per_si;
  return clean_mesh(std::move(mesh), file);
}

}  // namespace haptrace
