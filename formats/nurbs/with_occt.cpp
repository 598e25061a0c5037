// STEP and IGES files, read by OCCT.
#include "base/error.h"
#include "base/text_file.h"
#include "formats/nurbs/nurbs_file.h"

#include <Eigen/Geometry>

#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepTools.hxx>
#include <BRepTools_WireExplorer.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <GeomConvert.hxx>
#include <Geom_BSplineSurface.hxx>
#include <IGESControl_Reader.hxx>
#include <STEPControl_Reader.hxx>
#include <Standard_Failure.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Wire.hxx>
#include <cmath>
#include <fmt/format.h>
#include <memory>

namespace haptrace {
namespace {

constexpr double kMillimetre = 1e-3;              // OCCT turns the units of a file into millimetres
constexpr int kLeastParts = 8, kMostParts = 512;  // of a trimming edge, straight
constexpr double kBend = 1e-4;                    // of a part, off the curve, as a share of the curve's extent

TopoDS_Shape read_shape(const std::string& file) {
  const std::string ending = file_ending(file);
  std::unique_ptr<XSControl_Reader> reader;
  if (ending == ".igs" || ending == ".iges")
    reader = std::make_unique<IGESControl_Reader>();
  else
    reader = std::make_unique<STEPControl_Reader>();
  if (reader->ReadFile(file.c_str()) != IFSelect_RetDone)
    throw input_error(fmt::format("{}: is no valid {} file", file, ending.starts_with(".i") ? "IGES" : "STEP"));
  if (reader->TransferRoots() == 0) throw input_error(file + ": has no shape");
  return reader->OneShape();
}

NurbsData::Loop loop_of(const TopoDS_Wire& wire, const TopoDS_Face& face) {
  NurbsData::Loop loop;
  for (BRepTools_WireExplorer edges(wire, face); edges.More(); edges.Next()) {
    double first = 0, last = 0;
    const Handle(Geom2d_Curve) curve = BRep_Tool::CurveOnSurface(edges.Current(), face, first, last);
    if (curve.IsNull()) continue;
    if (edges.Current().Orientation() == TopAbs_REVERSED) std::swap(first, last);
    const auto at = [&](double share) {
      const gp_Pnt2d point = curve->Value(first + (last - first) * share);
      return Eigen::Vector2d(point.X(), point.Y());
    };
    int parts = kLeastParts;
    for (; parts < kMostParts; parts *= 2) {
      double bend = 0;
      Eigen::AlignedBox2d box;
      for (int i = 0; i < parts; ++i) {
        const Eigen::Vector2d a = at(static_cast<double>(i) / parts), b = at((i + 1.0) / parts);
        bend = std::max(bend, (at((i + 0.5) / parts) - 0.5 * (a + b)).norm());
        box.extend(a);
        box.extend(b);
      }
      if (bend <= kBend * box.diagonal().norm()) break;
    }
    for (int i = 0; i < parts; ++i) loop.push_back(at(static_cast<double>(i) / parts));
  }
  return loop;
}

/// Returns whether a loop is the edge of the whole domain.
bool is_whole(const NurbsData::Loop& loop, const NurbsData& patch) {
  const Eigen::Vector2d low(patch.least(0), patch.least(1)), size = Eigen::Vector2d(patch.most(0), patch.most(1)) - low;
  double area = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Eigen::Vector2d a = (loop[i] - low).cwiseQuotient(size),
                          b = (loop[(i + 1) % loop.size()] - low).cwiseQuotient(size);
    area += 0.5 * (a.x() * b.y() - a.y() * b.x());
    const double off = std::min(a.cwiseAbs().minCoeff(), (a - Eigen::Vector2d::Ones()).cwiseAbs().minCoeff());
    if (off > 1e-5) return false;
  }
  return std::abs(std::abs(area) - 1) < 1e-3;
}

NurbsData patch_of(const TopoDS_Face& oriented, const std::string& where) {
  const TopoDS_Face face = TopoDS::Face(oriented.Oriented(TopAbs_FORWARD));
  Handle(Geom_BSplineSurface) surface = Handle(Geom_BSplineSurface)::DownCast(BRep_Tool::Surface(face));
  if (surface.IsNull()) surface = GeomConvert::SurfaceToBSplineSurface(BRep_Tool::Surface(face));
  if (surface.IsNull()) throw input_error(where + ": cannot be converted to a B-spline");
  surface = Handle(Geom_BSplineSurface)::DownCast(surface->Copy());
  if (surface->IsUPeriodic()) surface->SetUNotPeriodic();
  if (surface->IsVPeriodic()) surface->SetVNotPeriodic();
  // The part of the surface that the face needs.
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0, least_u = 0, most_u = 0, least_v = 0, most_v = 0;
  BRepTools::UVBounds(face, u0, u1, v0, v1);
  surface->Bounds(least_u, most_u, least_v, most_v);
  const auto fit = [](double& from, double& to, double least, double most) {
    const double slack = 1e-6 * (most - least);
    from = from < least + slack ? least : from;
    to = to > most - slack ? most : to;
  };
  fit(u0, u1, least_u, most_u);
  fit(v0, v1, least_v, most_v);
  if (u1 > u0 && v1 > v0 && (u0 > least_u || u1 < most_u || v0 > least_v || v1 < most_v))
    surface->Segment(u0, u1, v0, v1);

  NurbsData patch;
  patch.degree = {surface->UDegree(), surface->VDegree()};
  patch.count = {surface->NbUPoles(), surface->NbVPoles()};
  if (std::max(patch.degree[0], patch.degree[1]) > kMostNurbsDegree)
    throw input_error(
        fmt::format("{}: its degree is {}; the most is {}. Export the file with surfaces of a lower degree", where,
                    std::max(patch.degree[0], patch.degree[1]), kMostNurbsDegree));
  for (const double knot : surface->UKnotSequence()) patch.knots[0].push_back(knot);
  for (const double knot : surface->VKnotSequence()) patch.knots[1].push_back(knot);
  for (int i = 1; i <= patch.count[0]; ++i)
    for (int j = 1; j <= patch.count[1]; ++j) {
      const gp_Pnt point = surface->Pole(i, j);
      patch.points.emplace_back(kMillimetre * point.X(), kMillimetre * point.Y(), kMillimetre * point.Z(),
                                surface->Weight(i, j));
    }
  patch.turned = oriented.Orientation() == TopAbs_REVERSED;

  const TopoDS_Wire outer = BRepTools::OuterWire(face);
  for (TopExp_Explorer wires(face, TopAbs_WIRE); wires.More(); wires.Next()) {
    const TopoDS_Wire wire = TopoDS::Wire(wires.Current());
    NurbsData::Loop loop = loop_of(wire, face);
    // The curves may leave the domain by their tolerance.
    for (Eigen::Vector2d& point : loop)
      point = point.cwiseMax(Eigen::Vector2d(patch.least(0), patch.least(1)))
                  .cwiseMin(Eigen::Vector2d(patch.most(0), patch.most(1)));
    if (loop.size() < 3 || (wire.IsSame(outer) && is_whole(loop, patch))) continue;
    (wire.IsSame(outer) ? patch.outer : patch.holes).push_back(std::move(loop));
  }
  return patch;
}

}  // namespace

bool reads_step_files() noexcept {
  return true;
}

std::vector<NurbsData> load_nurbs_with_occt(const std::string& file) {
  try {
    BRepBuilderAPI_NurbsConvert convert(read_shape(file), true);
    std::vector<NurbsData> patches;
    for (TopExp_Explorer faces(convert.Shape(), TopAbs_FACE); faces.More(); faces.Next())
      patches.push_back(patch_of(TopoDS::Face(faces.Current()), fmt::format("{}: face {}", file, patches.size() + 1)));
    return patches;
  } catch (const Standard_Failure& failure) {
    throw input_error(fmt::format("{}: cannot be read: {}", file, failure.GetMessageString()));
  }
}

}  // namespace haptrace
