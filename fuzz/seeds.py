"""Writes the seeds of the fuzz targets: small files of every kind that cfreg reads.

    python fuzz/seeds.py [FOLDER]

They are in the repository, and made anew only when a format is added. Those of Parquet want
pyarrow, and are left as they are where it is not there; so are LAS, LAZ and E57 without a FOLDER that has a.las, a.laz and a.e57.
"""

import gzip as gzip_
import io
import json
import math
import struct
import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).parent / "seeds"
POINTS = [
    (math.cos(0.7 * i), math.sin(1.1 * i), 0.25 * (i % 5) - 0.3) for i in range(8)
]
NORMALS = [(0.0, 0.6, 0.8), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)] * 2


def save(target, name, content):
    path = HERE / target / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def rows(table, separator=" "):
    return "".join(separator.join(f"{x:g}" for x in row) + "\n" for row in table)


def ply():
    xyz = "".join(f"property float {axis}\n" for axis in "xyz")

    def header(form, rest, count=8):
        return f"ply\nformat {form} 1.0\ncomment a seed\nelement vertex {count}\n{rest}end_header\n"

    save("ply", "ascii.ply", header("ascii", xyz) + rows(POINTS))
    full = xyz + "".join(f"property float n{axis}\n" for axis in "xyz")
    full += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    full += "property double weight\nproperty short intensity\n"
    table = [(*p, *n, 255, 10 * i, 0, 0.5 * i, -i) for i, (p, n) in enumerate(zip(POINTS, NORMALS))]
    save("ply", "full-ascii.ply", header("ascii", full) + rows(table))
    for form, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        body = b"".join(struct.pack(order + "6f3Bdh", *row) for row in table)
        save("ply", f"full-{form}.ply", header(form, full).encode() + body)
    doubles = "".join(f"property float64 {axis}\n" for axis in "xyz")
    body = b"".join(struct.pack("<3d", 5e5 + x, 5.6e6 + y, z) for x, y, z in POINTS)
    body += struct.pack("<3d", math.nan, 0, math.inf)
    save("ply", "map.ply", header("binary_little_endian", doubles, 9).encode() + body)
    faces = "element face 3\nproperty list uchar int vertex_indices\n"
    save("ply", "mesh.ply", header("ascii", xyz + faces) + rows(POINTS) + "3 0 1 2\n4 2 3 4 5\n3 5 6 7\n")
    body = b"".join(struct.pack("<3f", *p) for p in POINTS)
    for corners in ((0, 1, 2), (2, 3, 4, 5), (5, 6, 7)):
        body += struct.pack(f"<B{len(corners)}i", len(corners), *corners)
    save("ply", "mesh-binary.ply", header("binary_little_endian", xyz + faces).encode() + body)
    lists = xyz + "property list uchar float tail\n"
    body = b"".join(struct.pack("<3fB2f", *p, 2, 1.0, 2.0) for p in POINTS)
    save("ply", "list.ply", header("binary_little_endian", lists).encode() + body)
    grid = "element range_grid 9\nproperty list uchar int vertex_indices\n"
    infos = "obj_info num_cols 3\nobj_info num_rows 3\n"
    text = header("ascii", xyz + grid).replace("element vertex", infos + "element vertex")
    save("ply", "range-grid.ply", text + rows(POINTS) + "".join(f"1 {i}\n" for i in range(8)) + "0\n")
    save("ply", "crlf.ply", (header("ascii", xyz) + rows(POINTS)).replace("\n", "\r\n"))
    camera = "element camera 1\nproperty float view_px\n"
    text = header("ascii", xyz).replace("element vertex", camera + "element vertex")
    save("ply", "other-element.ply", text + "1.5\n" + rows(POINTS))


def lzf(data):
    """Literal runs, and the last byte as often as it repeats."""
    packed, at = b"", 0
    while at < len(data):
        run = 1
        while at + run < len(data) and run < 264 and data[at + run] == data[at]:
            run += 1
        if run >= 4:
            packed += bytes([0, data[at]])
            length = run - 1 - 2
            packed += bytes([length << 5, 0]) if length < 7 else bytes([7 << 5, length - 7, 0])
            at += run
        else:
            piece = data[at : at + 32]
            packed += bytes([len(piece) - 1]) + piece
            at += len(piece)
    return packed


def pcd():
    def header(fields, sizes, types, counts, data, width=8, height=1, viewpoint="0 0 0 1 0 0 0"):
        return (
            f"# .PCD v.7 - Point Cloud Data file format\nVERSION .7\nFIELDS {fields}\nSIZE {sizes}\n"
            f"TYPE {types}\nCOUNT {counts}\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT {viewpoint}\n"
            f"POINTS {width * height}\nDATA {data}\n"
        )

    plain = ("x y z", "4 4 4", "F F F", "1 1 1")
    save("pcd", "ascii.pcd", header(*plain, "ascii") + rows(POINTS))
    save("pcd", "organised.pcd", header(*plain, "ascii", 4, 2, "1 2 3 1 0 0 0") + rows(POINTS))
    nan = rows(POINTS[:6]) + "nan nan nan\n0 0 0\n"
    save("pcd", "nan.pcd", header(*plain, "ascii") + nan)
    full = (
        "x y z normal_x normal_y normal_z rgb weight ring _ fpfh",
        "4 4 4 4 4 4 4 8 2 1 4",
        "F F F F F F F F U U F",
        "1 1 1 1 1 1 1 1 1 4 2",
    )
    records = [
        struct.pack("<6fIdH4B2f", *p, *n, 0x102030 + i, 0.5 * i, i, 0, 0, 0, 0, 1.0, 2.0)
        for i, (p, n) in enumerate(zip(POINTS, NORMALS))
    ]
    body = b"".join(records)
    save("pcd", "full-binary.pcd", header(*full, "binary").encode() + body)
    # Compressed: field after field.
    widths = [4] * 7 + [8, 2, 4, 8]
    fields, at = b"", 0
    for width in widths:
        fields += b"".join(record[at : at + width] for record in records)
        at += width
    packed = lzf(fields)
    sizes = struct.pack("<II", len(packed), len(fields))
    save("pcd", "full-compressed.pcd", header(*full, "binary_compressed").encode() + sizes + packed)
    floats = b"".join(struct.pack("<3f", *p) for p in POINTS)
    save("pcd", "binary.pcd", header(*plain, "binary").encode() + floats)
    zeros = bytes(8 * 12)
    packed = lzf(zeros)
    sizes = struct.pack("<II", len(packed), len(zeros))
    save("pcd", "zeros-compressed.pcd", header(*plain, "binary_compressed").encode() + sizes + packed)
    ints = ("x y z rgba", "8 8 8 4", "F F F U", "1 1 1 1")
    body = b"".join(struct.pack("<3dI", 5e5 + x, 5.6e6 + y, z, 0xFF00FF00) for x, y, z in POINTS)
    save("pcd", "doubles.pcd", header(*ints, "binary").encode() + body)


def text():
    # The name of the file follows from the length: all of them come up under mutation.
    save("text", "spaces", rows(POINTS))
    save("text", "semicolons", rows(POINTS, ";"))
    table = [(*p, *n) for p, n in zip(POINTS, NORMALS)]
    save("text", "normals", rows(table))
    save("text", "titled", "x,y,z,nx,ny,nz,intensity\n" + rows([(*r, 0.5) for r in table], ","))
    save("text", "comments", "# x y z weight\n// another\n" + rows([(*p, 2) for p in POINTS]) + "\n\n")
    save("text", "counted", "8\n" + rows([(*p, 3, 255, 0, 7) for p in POINTS]))
    save("text", "tabs-crlf", rows(POINTS, "\t").replace("\n", "\r\n"))
    save("text", "numbers", "1e3 -0.0 +5\n.5 5. 1E-3\nnan 0 0\ninf 1 2\n5e5 5.6e6 1\n")
    save("text", "marked", b"\xef\xbb\xbfx y z\n" + rows(POINTS).encode())
    save("text", "quoted", '"x","y","z","name"\n1,2,3,"a"\n')


def formats(made):
    """Formats of other programs; LAS, LAZ and E57 are the a.las, a.laz and a.e57 of the folder
    `made`, which any program may write (`cfreg convert`)."""
    for name in ("a.las", "a.laz", "a.e57"):
        if made and (made / name).exists():
            target = "e57" if name == "a.e57" else "las"
            save(target, name, (made / name).read_bytes())
            if target == "las":
                save("apply", name, (made / name).read_bytes())
    flat = b"".join(struct.pack("<3f", *p) for p in POINTS)
    header = "{'descr': %s, 'fortran_order': False, 'shape': %s, }\n"

    def npy(descr, shape, data):
        text = (header % (descr, shape)).encode()
        return b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text + data

    plain = npy("'<f4'", "(8, 3)", flat)
    records = "[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('rgb', '|u1', (3,))]"
    rows_ = b"".join(struct.pack("<3f3B", *p, 1, 2, 3) for p in POINTS)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("points.npy", plain)
        packed.writestr("glow.npy", npy("'<f4'", "(8,)", struct.pack("<8f", *range(8))))
    kitti = b"".join(struct.pack("<4f", *p, 0.5) for p in POINTS)
    for name, content in (
        ("a.npy", plain),
        ("b.npy", npy(records, "(8,)", rows_)),
        ("a.npz", archive.getvalue()),
        ("a.bin", kitti),
    ):
        save("arrays", name, content)
    obj = "".join("v %g %g %g\n" % p for p in POINTS) + "vn 0 0 1\nf 1 2 3\nf 2//1 3//1 -1//1\n"
    save("meshes", "a.obj", obj)
    off = "OFF\n8 1 0\n" + rows(POINTS) + "3 0 1 2\n"
    save("meshes", "a.off", off)
    save("meshes", "b.off", "CNOFF\n1 0 0\n1 2 3 0 0 1 255 0 0 255\n")
    corner = "".join("vertex %g %g %g\n" % p for p in POINTS[:3])
    ascii_ = f"solid a\nfacet normal 0 0 1\nouter loop\n{corner}endloop\nendfacet\nendsolid a\n"
    save("meshes", "a.stl", ascii_)
    binary = b" " * 80 + struct.pack("<I", 1) + struct.pack("<3f", 0, 0, 1) + flat[:36] + b"\0\0"
    save("meshes", "b.stl", binary)
    scan = "2\n4\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n"
    scan += "".join("%g %g %g 0.5\n" % p for p in POINTS[:7]) + "0 0 0 0.5\n"
    save("ptx", "a.ptx", scan)
    save("ptx", "b.ptx", scan * 2)
    xyz = "".join(f"property float {axis}\n" for axis in "xyz")
    ply_ = f"ply\nformat ascii 1.0\nelement vertex 8\n{xyz}end_header\n{rows(POINTS)}"
    save("gzip", "a.ply.gz", gzip_.compress(ply_.encode(), mtime=0))
    for name, content in (("a.ply", ply_), ("a.obj", obj), ("a.ptx", scan), ("a.xyz", rows(POINTS))):
        save("apply", name, content)
    save("apply", "a.npy", plain)
    save("apply", "a.stl", binary)


def tables_of_numbers():
    def npy(name, descr, shape, data, order="False", version=1):
        header = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n"
        length = struct.pack("<H" if version == 1 else "<I", len(header))
        save("arrays", name, b"\x93NUMPY" + bytes([version, 0]) + length + header.encode() + data)

    flat = [x for point in POINTS for x in point]
    for descr, letter in (("<f2", "<24e"), (">f4", ">24f"), ("<f8", "<24d")):
        npy(f"points{descr[1:]}.npy", descr, "(8, 3)", struct.pack(letter, *flat))
    npy("columns.npy", "<f8", "(8, 3)", struct.pack("<24d", *flat), "True", 2)
    npy("pairs.npy", "<i8", "(3, 2)", struct.pack("<6q", 0, 1, 2, 3, 4, 5))
    npy("scored.npy", "<f4", "(2, 3)", struct.pack("<6f", 0, 1, 0.5, 2, 3, 0.25))
    npy("scores.npy", "|u1", "(4,)", bytes(range(4)))
    npy("nan.npy", "<f4", "(1, 2)", struct.pack("<2f", math.nan, math.inf))


def pose():
    matrix = [[0.36, 0.48, -0.8, 1.5], [-0.8, 0.6, 0.0, -2.0], [0.48, 0.64, 0.6, 0.25], [0, 0, 0, 1]]
    save("pose", "matrix.txt", "# a pose\n" + rows(matrix))
    save("pose", "commas.txt", rows(matrix, ", "))
    save("pose", "rows.json", json.dumps(matrix))
    save("pose", "object.json", json.dumps({"method": "cf", "transform": matrix}))
    scaled = [[2.5 * x for x in row[:3]] + row[3:] for row in matrix[:3]] + matrix[3:]
    save("pose", "scaled.txt", rows(scaled))
    return matrix


def tables(matrix):
    save("list", "pairs.csv", "id,source,target\n1,a.ply,b.ply\n2, b.ply ,c.ply\n# no pair\n3,a.ply,c.ply\n")
    save("list", "quoted.csv", 'target,source\n"a, b.ply","c ""d"".ply"\ne.ply,f.ply\n')
    save("list", "places.csv", "cloud,x,y,z,yaw\na.ply,0,0,0,1\nb.ply,0.5,0,0,2\nc.ply,9,1e3,-2,3\n")
    save("list", "both.csv", "cloud,x,y,z,source,target\na,0,0,0,a,b\nb,0,0.5,0,b,a\n")
    entries = [f"t{i}{j}" for i in range(4) for j in range(4)]
    flat = [x for row in matrix for x in row]
    info = [f"info{i}{j}" for i in range(6) for j in range(i, 6)]
    full = {"index": 0, "source": "a.ply", "target": "b.ply", "error": None, "trusted": True}
    full |= {"doubts": None, "decision": "accept", "probability": 0.98, "overlap": 0.6, "reasons": "x; y"}
    full |= dict(zip(entries, flat)) | {"scale": 1.0}
    full |= {name: float(name[4] == name[5]) for name in info}
    full |= {"center_x": 0.1, "center_y": 0.2, "center_z": -0.3, "undetermined": 0}
    full |= {"fitness": 0.7, "max_distance": 0.1, "source_points": 100, "iterations": 3}
    other = dict.fromkeys(full) | {"index": 1, "source": "b.ply", "target": "c.ply", "error": "no such file"}
    doubted = full | {"index": 2, "source": "c.ply", "trusted": False, "decision": "ambiguous"}
    line = lambda row: json.dumps(row, separators=(",", ":")) + "\n"
    save("rows", "full.jsonl", line(full))
    save("rows", "error.jsonl", line({k: v for k, v in other.items() if v is not None or k == "trusted"}))
    short = {k: v for k, v in doubted.items() if not k.startswith("info")}
    save("rows", "doubted.jsonl", line(short) + line({"index": 3, "source": "a", "target": "a"}))
    word = lambda x: "" if x is None else str(x).lower() if isinstance(x, bool) else str(x)
    csv = lambda table: "".join(",".join(map(word, row)) + "\n" for row in table)
    save("rows", "full.csv", csv([full, full.values(), other.values()]))
    save("rows", "short.csv", csv([short, short.values()]))
    save("rows", "least.csv", 'index,source,target,error\n0,"a,b",c,"it, said ""no"""\n1,d,e,\n')
    columns = ["dataset", "source", "target", *entries, "overlap", "units", "method", "accepted"]
    pairs = [["x", "a", "b", *flat, 0.5, "cm", "m", "true"], ["x", "b", "c", *[""] * 16, "", "m", "m", ""]]
    save("benchmark", "pairs.csv", csv([columns, *pairs]))
    save("benchmark", "gt.log", "0\t 2\t 60\n" + rows(matrix) + "1 3 60\n" + rows(matrix))
    save("benchmark", "one.log", "0 1 2\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    parquet(full, other)


def parquet(full, other):
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        print("Parquet: left as it is, pyarrow is not there")
        return

    def write(name, table, **options):
        path = HERE / "parquet" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, path, store_schema=False, write_statistics=False, **options)

    names = {"source": ["a.ply", "b.ply", "a.ply", "c.ply"] * 3, "target": ["b.ply", "c.ply"] * 6}
    for version in ("1.0", "2.0"):
        options = {"data_page_version": version}
        write(f"plain-{version}.parquet", pa.table(names), compression="none", use_dictionary=False, **options)
        write(f"dictionary-{version}.parquet", pa.table(names), compression="snappy", **options)
    write("delta.parquet", pa.table(names), compression="none", use_dictionary=False,
          column_encoding={"source": "DELTA_BYTE_ARRAY", "target": "DELTA_LENGTH_BYTE_ARRAY"})
    keys = ["index", "source", "target", "error", "trusted", "probability"]
    table = pa.table({key: [full[key], other[key]] for key in keys})
    write("rows.parquet", table, compression="snappy", use_dictionary=False)
    write("rows-dictionary.parquet", table, compression="none")
    nested = pa.table({"source": ["a"], "target": ["b"], "list": [[1, 2]], "map": [{"k": 1.5}]})
    write("nested.parquet", nested, compression="none", use_dictionary=False)


def report(matrix):
    counts = {"dropped": 0, "used": 4, "keypoints": None, "described": 4, "oriented_by": "frame-origin"}
    least = {"transform": matrix, "method": "cf", "trusted": False}
    least |= {"doubts": [{"ground": "low-agreement", "message": "they hardly agree"}]}
    fit = {"fitness": 0.6, "target_fitness": 0.5, "inlier_rmse": 0.04, "max_distance": 0.1, "agreement": 0.5}
    full = least | {"trusted": True, "doubts": [], "evaluation": fit, "connections": 16, "iterations": 1}
    full |= {"stop": "one-step", "points": {"source": counts, "target": counts}}
    full |= {"time_s": {"read": 0.1, "total": 0.1}, "source": "a.ply", "target": "b.ply"}
    full |= {"thinning": {"voxel": None, "sample": 4, "seed": 1}, "viewpoints": "file", "command": "cfreg"}
    matrix6 = [[float(i == j) for j in range(6)] for i in range(6)]
    free = {"rotation": [0, 0, 1], "translation": [0, 0, 0]}
    verdict = {"decision": "ambiguous", "probability": 0.6, "reasons": ["one", "two"], "overlap": 0.4}
    verdict |= {"runner_up": {"transform": matrix, "probability": 0.3}, "other_scale": 1.02}
    verdict |= {"covariance": {"matrix": matrix6, "center": [0, 0, 0], "undetermined": [free]}}
    compact = lambda value: json.dumps(value, separators=(",", ":"))
    save("report", "least.json", compact(least))
    save("report", "full.json", compact(full))
    save("report", "verdict.json", compact(full | {"method": "consensus", "verdict": verdict}))
    save("report", "refined.json", compact(least | {"refined_from": full | {"config": {"method": "cf"}}}))


def settings():
    save("settings", "set", "beta auto\nneighbors 40\nweights student-t:3\nnormalize sinkhorn:3\n")
    save("settings", "prior", 'prior {"direction":[[0,0,1],[0,0,1]],"rotation":{"vector":[0,0,1],"within_deg":9}}\n')
    save("settings", "scales", 'more_neighbors [200,"300:50"]\nchannels ["red:0.5","intensity"]\nviewpoint [1,2,3]\n')
    save("settings", "cf.json", '{"method":"cf","beta":"auto:0.5","weights":"cauchy","neighborhood":{"radius":0.1}}')
    save("settings", "consensus.json", '{"method":"consensus","voxel":0.1,"seeds":50,"channels":[{"name":"red","share":2}]}')
    save("settings", "icp.json", '{"method":"icp","max_distance":0.5,"keep":0.9,"metric":"plane","threads":2}')
    kernel = {"kernel": "gaussian", "beta": 50}
    nested = {"sum": [kernel, {"times": [0.3, {"product": [kernel, {"kernel": "student-t:3", "beta": 20}]}]}]}
    save("settings", "kernel.json", json.dumps(nested))
    save("settings", "prior.json", '{"direction":[[0,0,1],[0,1,0]],"scale":[0.5,2]}')
    for name in ("student-t:3", "auto:0.5", "sinkhorn:10", "cf-multiscale+gicp+icp", "intensity:0.5", "both"):
        save("settings", "name-" + name.replace(":", "-"), name)


def choices():
    """Bytes of the targets that make their inputs of them: any will do."""
    save("journal", "header-and-row", b"\x01" + b'{"index":0,"source":"a","target":"b","error":null}\n')
    save("journal", "foreign", b"\x00mine\n")
    save("journal", "behind", b"\x02" + b'{"index":4,"source":"c","target":"a"')
    for k in range(12):
        save("journal", f"edited-{k}", bytes([3] + [(31 * i + 7 * k * i + k) % 256 for i in range(24)]))
    for k in range(16):
        save("round_trip", f"{k}", bytes([1 + k % 2] + [(57 * i + 11 * k * (i + 1)) % 256 for i in range(40)]))
        save("round_trip", f"any-{k}", bytes([0, 3] + [(91 * i + 13 * k * i + k) % 256 for i in range(80)]))
    for method in range(18):
        for k in range(4):
            rest = bytes((73 * i + 29 * k * (i + 1) + 5 * method) % 256 for i in range(48))
            save("registration", f"{method}-{k}", bytes([method, 16, 16, 1]) + rest)


if __name__ == "__main__":
    ply()
    pcd()
    text()
    formats(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    tables_of_numbers()
    matrix = pose()
    tables(matrix)
    report(matrix)
    settings()
    choices()
