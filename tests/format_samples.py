"""A small file of every format, and of every variant that is read; all hold the same mesh."""

import base64
import io
import struct
import zlib
from importlib.util import find_spec

import numpy as np

# Two quads and a triangle on six vertices and one that no cell uses:
#   3 -- 4 -- 5
#   |    |    | \
#   0 -- 1 -- 2 - 6      7 alone
POINTS = [(0, 0), (1, 0), (2, 0), (0, 1), (1.1, 0.9), (2, 1), (3, 0), (9, 9)]
QUADS = [(0, 1, 4, 3), (1, 2, 5, 4)]
TRIANGLES = [(2, 6, 5)]
XYZ = "".join(f"{x} {y} 0\n" for x, y in POINTS)

OFF = f"""OFF # a comment

# counts
8 3 0
{XYZ}4 0 1 4 3  255 0 0
4  1 2 5 4
3\t2 6 5 0.5 0.5 0.5 # grey
"""
COFF = "COFF\n8 3 0\n" + XYZ.replace(" 0\n", " 0  1 0 0 1\n") + "4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n"
NOFF = "NOFF 8 3 0\n" + XYZ.replace(" 0\n", " 0  0 0 1\n") + "4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n"
FLOWING = "OFF 8 3 0 " + XYZ.replace("\n", " ") + "4 0 1 4 3 4 1 2 5 4 3 2 6 5"
OBJ = (
    "# made by hand\nmtllib a.mtl\no plate\n"
    + "".join(f"v {x} {y} 0\n" for x, y in POINTS)
    + "vt 0 0\nvn 0 0 1\ng left\nusemtl red\nf 1/1/1 2/1/1 5//1 4/1\nf -7 -6 -3 -4\nl 1 2 3\np 8\n"
    + "s off\nf 3 7 \\\n 6\n"
)
MSH2 = (
    '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n1 9 "shore"\n2 5 "left part"\n'
    "$EndPhysicalNames\n$Comments\nanything\n$EndComments\n$Nodes\n8\n"
    + "".join(f"{10 * i + 5} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$EndNodes\n$Elements\n5\n1 15 2 0 1 5\n2 1 2 9 1 5 15\n3 3 2 5 1 5 15 45 35\n"
    "4 3 2 6 2 15 25 55 45\n7 2 3 6 2 0 25 65 55\n$EndElements\n$Periodic\n0\n$EndPeriodic\n"
)
MSH20 = (
    MSH2.replace("2.2 0 8", "2 0 8")
    .replace('1 9 "shore"', '9 "shore"')
    .replace('2 5 "left part"', '5 "left part"')
    .replace("\n", "\r\n")
)
MSH1 = (
    "$NOD\n8\n"
    + "".join(f"{i + 1} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$ENDNOD\n$ELM\n3\n1 3 5 1 4 1 2 5 4\n2 3 6 1 4 2 3 6 5\n3 2 6 1 3 3 7 6\n$ENDELM\n"
)
MSH4 = (
    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 1 2 0\n1 0 0 0 0\n"
    "1 0 0 0 1 0 0 1 9 2 1 1\n1 0 0 0 1 1 0 1 5 1 1\n2 1 0 0 2 1 0 1 6 0\n$EndEntities\n"
    "$Nodes\n2 8 1 8\n1 1 1 3\n1\n2\n3\n0 0 0 0.0\n1 0 0 0.5\n2 0 0 1.0\n2 1 0 5\n4\n5\n6\n7\n8\n"
    + "".join(f"{x} {y} 0\n" for x, y in POINTS[3:])
    + "$EndNodes\n$Elements\n4 4 1 4\n1 1 1 1\n1 1 2\n2 1 3 1\n2 1 2 5 4\n2 2 3 1\n3 2 3 6 5\n"
    "2 2 2 1\n4 3 7 6\n$EndElements\n"
)
MSH40 = (
    "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n1 8\n1 2 0 8\n"
    + "".join(f"{i + 1} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$EndNodes\n$Elements\n2 3\n1 2 3 2\n1 1 2 5 4\n2 2 3 6 5\n2 2 2 1\n3 3 7 6\n$EndElements\n"
)
VTK = (
    "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\n"
    "time 1 1 double\n0.25\nPOINTS 8 float\n"
    + XYZ
    + "CELLS 5 20\n4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n3 0 1 2\n1 7\nCELL_TYPES 5\n9 9 5 4 1\n"
    "CELL_DATA 5\nSCALARS material int 1\nLOOKUP_TABLE default\n7 8 8 0 0\n"
    "POINT_DATA 8\nVECTORS wind double\n" + XYZ + "METADATA\nINFORMATION 0\n\n"
    "SCALARS fixed bit\n1 1 1 1 0 1 1 1\n"
)
VTK5 = (
    "# vtk DataFile Version 5.1\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
    + XYZ
    + "CELLS 4 11\nOFFSETS vtktypeint64\n0 4 8 11\nCONNECTIVITY vtktypeint64\n"
    "0 1 4 3 1 2 5 4 2 6 5\nCELL_TYPES 3\n9\n9\n5\n"
)
POLYDATA = (
    "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 8 double\n"
    + XYZ
    + "POLYGONS 3 14\n4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\nLINES 1 3\n2 0 1\n"
    "CELL_DATA 4\nSCALARS material int\nLOOKUP_TABLE default\n0 7 8 8\n"
)
PLY = (
    "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 8\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\nelement face 3\nproperty list uchar int vertex_indices\n"
    "property int flag\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    + XYZ.replace(" 0\n", " 0 255\n")
    + "4 0 1 4 3 1\n4 1 2 5 4 1\n3 2 6 5 1\n0 1\n"
)
SU2 = (
    "% by hand\nNDIME= 2\nNPOIN= 8 8\n"
    + "".join(f"{x}\t{y} {i}\n" for i, (x, y) in enumerate(POINTS))
    + "NELEM= 3\n9 0 1 4 3 0\n9 1 2 5 4 1\n5 2 6 5 2\nNMARK= 2\nMARKER_TAG= shore\n"
    "MARKER_ELEMS= 2\n3 0 1\n3 1 2\nMARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 1\nSEND_TO= 1\n1 7\n"
)
ABAQUS = (
    "*Heading\n plate, by hand\n** a comment, with = and 1, 2, 3\n*NODE, NSET=ALL\n"
    + "".join(f"{10 * i + 5}, {x:.1f}, {y:.2e}, 0.\n" for i, (x, y) in enumerate(POINTS))
    + "*Element, type=CPE4R,\n elset=left\n1, 5, 15, 45, 35\n*ELEMENT, TYPE=S4, ELSET=right\n"
    "2, 15, 25, 55, 45\n*ELEMENT, TYPE=S3R, ELSET=RIGHT\n3, 25, 65, 55\n"
    "*ELEMENT, TYPE=T2D2, ELSET=rim\n4, 5, 15\n*NSET, NSET=fixed, GENERATE\n5, 25, 10\n"
    "*ELSET, ELSET=both\nleft, right\n*MATERIAL, NAME=steel\n*ELASTIC\n210000., 0.3\n"
)
HOHQ = (
    "*Heading\n File created by HOHQMesh\n*NODE\n"
    + "".join(f"{i + 1}, {x}, {y}, 0.0\n" for i, (x, y) in enumerate(POINTS))
    + "*ELEMENT, type=CPS4, ELSET=Surface1\n1, 1, 2, 5, 4\n2, 2, 3, 6, 5\n"
    "** ***** HOHQMesh boundary information ***** **\n** mesh polynomial degree = 2\n"
    "**  1 2 5 4\n**  0 0 0 0\n**  2 3 6 5\n**  0 0 0 0\n** shore --- --- ---\n** --- --- far ---\n"
)
HOHQ_CURVED = HOHQ.replace(
    "**  0 0 0 0\n**  2", "**  1 0 0 0\n**  0 0 0\n**  0.5 -0.1 0\n**  1 0 0\n**  2"
)
TECPLOT_POINT = (
    '# by hand\nTITLE = "a plate"\nVARIABLES = "X", "Y [m]" "depth, m"\nDATASETAUXDATA by="hand"\n'
    'ZONE T="left", N=8, E=3,\n F=FEPOINT, ET=QUADRILATERAL\n'
    + "".join(f"{x} {y} {i}.5\n" for i, (x, y) in enumerate(POINTS))
    + "1 2 5 4\n2 3 6 5\n3 7 6 6\n"
)
TECPLOT_BLOCK = (
    "variables = x y p material\nzone nodes=8, elements=3, datapacking=block\n"
    'zonetype=fequadrilateral, varlocation=([3-4]=cellcentered)\nAUXDATA a="b"\n'
    + " ".join(str(x) for x, _ in POINTS)
    + "\n"
    + " ".join(str(y) for _, y in POINTS)
    + "\n0.1 0.2 nan\n7 8 8\n1 2 5 4 2 3 6 5\n3 3 7 6\n"
)
# Two zones on the same points, then a later step of the first.
TECPLOT_ZONES = (
    "VARIABLES = x, y, z, p\nZONE T=left, N=8, E=1, ZONETYPE=FEQUADRILATERAL, DATAPACKING=POINT\n"
    + XYZ.replace(" 0\n", " 0 1.5\n")
    + "1 2 5 4\nZONE T=right, N=8, E=2, ZONETYPE=FEQUADRILATERAL, DATAPACKING=POINT\n"
    "VARSHARELIST=([1-4]=1)\n2 3 6 5\n3 7 6 6\n"
    "ZONE T=left, N=8, E=1, ZONETYPE=FEQUADRILATERAL, DATAPACKING=POINT, STRANDID=1\n"
    "VARSHARELIST=([1-3]=1), CONNECTIVITYSHAREZONE=1\n1 2 3 4 5 6 7 8\n"
)
UCD = (
    "# by hand\n8 4 1 0 0\n"
    + "".join(f"{10 * i + 5} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "1 7 quad 5 15 45 35\n2 8 quad 15 25 55 45\n3 8 tri 25 65 55\n4 1 line 5 15\n"
    "1 1\ndepth, m\n" + "".join(f"{10 * i + 5} 1.5\n" for i in range(8))
)
MEDIT = (
    "MeshVersionFormatted 2 # by hand\nDimension\n2\nVertices\n8\n"
    + "".join(f"{x} {y} 3\n" for x, y in POINTS)
    + "Edges 1\n1 2 9\nQuadrilaterals\n2\n1 2 5 4 7\n2 3 6 5 8\nTriangles\n1\n3 7 6 8\n"
    "Corners\n2\n1\n3\nEnd\n"
)
MFEM = (
    "MFEM mesh v1.0\n\n# by hand\ndimension\n2\n\nelements\n3\n"
    "7 3 0 1 4 3\n8 3 1 2 5 4\n8 2 2 6 5\n\nboundary\n1\n9 1 0 1\n\nvertices\n8\n2\n"
    + "".join(f"{x} {y}\n" for x, y in POINTS)
)
SMS = (
    'MESH2D # by hand\nMESHNAME "plate # 1"\nNUM_MATERIALS_PER_ELEM 1\n'
    "E4Q 1 5 15 45 35 7\nE4Q 2 15 25 55 45 8 0.5\nE3T 3 25 65 55 8\n"
    + "".join(f"ND {10 * i + 5} {x} {y} -2.5\n" for i, (x, y) in enumerate(POINTS))
    + 'NS 5 15\nNS -25 9 "shore"\nNS -75 3\nBEGPARAMDEF\nMAT 7 "left part"\nENDPARAMDEF\n'
    'BEGCURVE Version: 1\nXYS 1 2 "Curve"\n0.0 1.0\n6.0 2.0\nENDCURVE\n'
)
ADCIRC = (
    "plate ! by hand\n3 8 ! elements, nodes\n"
    + "".join(f"{10 * i + 5} {x} {y} 2.5D0\n" for i, (x, y) in enumerate(POINTS))
    + "1 4 5 15 45 35\n2 4 15 25 55 45\n3 3 25 65 55\n! boundaries\n"
    "1 = Number of open boundaries\n2 = Total number of open boundary nodes\n2 = Number of nodes\n"
    "5\n15\n1 = Number of land boundaries\n2 = Total\n2 20 = Number of nodes for land boundary 1\n"
    "15\n25\n"
)
MIKE = (
    "100079 1000 8 UTM-33\n"
    + "".join(f"{10 * i + 5} {x} {y} -2.5 {i % 2}\n" for i, (x, y) in enumerate(POINTS))
    + "3 4 25\n1 5 15 45 35\n2 15 25 55 45\n3 25 65 55 0\n"
)
OLD_MIKE = MIKE.replace("100079 1000 8", "8").replace("55 0\n", "55\n")
XDA = (
    "libMesh-1.8.0\n3\t # number of elements\n8\t # number of nodes\n"
    ".\t # boundary condition specification file\n.\t # subdomain id specification file\n"
    "n/a\t # processor id specification file\nn/a\t # p-level specification file\n"
    "8\t # type size\n8\t # uid size\n0\t # pid size\n8\t # sid size\n0\t # p-level size\n"
    "8\t # eid size\n8\t # side size\n8\t # bid size\n0\t # extra integer size\n"
    + 3
    * "0\t # vector length\n\t # names\n"
    + "1\t # subdomain id to name map\n1\t # vector length\n7\t \n1\t # vector length\nleft\t \n"
    "3\t # n_elem at level 0, [ type uid sid (n0 ... nN-1) ]\n"
    "5 8 7 0 1 4 3\n5 9 8 1 2 5 4\n3 10 8 2 6 5\n"
    + XYZ
    + "1\t # presence of unique ids\n0\n1\n2\n3\n4\n5\n6\n7\n"
    "1\t # sideset id to name map\n1\t # vector length\n9\t \n1\t # vector length\nshore\t \n"
    "2\t # number of side boundary conditions\n0 0 9\n1 0 9\n"
    "1\t # nodeset id to name map\n1\t # vector length\n4\t \n1\t # vector length\nislet\t \n"
    "2\t # number of nodesets\n7 4\n3 5\n"
    "0\t # sideset id to name map\n0\t # number of edge boundary conditions\n"
    "0\t # sideset id to name map\n0\t # number of shellface boundary conditions\n"
)
XDA07 = (
    "libMesh-0.7.0+\t \n3\t\t # number of elements\n8\t\t # number of nodes\n"
    ".\t\t # boundary\n.\t\t # subdomain\nn/a\t\t # processor\nn/a\t\t # p-level\n"
    "3\t\t # n_elem at level 0, [ type sid (n0 ... nN-1) ]\n"
    "5 7 0 1 4 3\n5 8 1 2 5 4\n3 8 2 6 5\n" + XYZ + "1     # number of boundary conditions\n0 0 3\n"
)
NODES_H1 = (
    MFEM[: MFEM.index("2\n0 0\n")]
    + "\nnodes\nFiniteElementSpace\nFiniteElementCollection: H1_2D_P1\nVDim: 2\nOrdering: 0\n\n"
    + "".join(f"{x}\n" for x, _ in POINTS)
    + "".join(f"{y}\n" for _, y in POINTS)
)
# The corners of quads in lexicographic order; the vertex that no cell uses has no place.
NODES_L2 = (
    MFEM[: MFEM.index("2\n0 0\n")]
    + "\nnodes\nFiniteElementSpace\nFiniteElementCollection: L2_T1_2D_P1\nVDim: 2\nOrdering: 1\n\n"
    + "".join("{} {}\n".format(*POINTS[v]) for v in (0, 1, 3, 4, 1, 2, 4, 5, 2, 6, 5))
)
FREEFEM = (
    "8 5 2\n"
    + "".join(f" {x}   {y:.3E}       3\n" for x, y in POINTS)
    + "1 2 5 7\n1 5 4 7\n2 3 6 8\n2 6 5 8\n3 7 6 8\n1 2 9\n2 3 9\n"
)
ISM_NODES = "".join(f"  {x:.16f}   {y:.16f}   0.0000000000000000E+00 \n" for x, y in POINTS)
ISM = (
    " 8 2 2\n" + ISM_NODES + " 1 2 5 4\n 0 0 0 0\n shore --- --- ---\n"
    " 2 3 6 5\n 0 0 0 0\n --- --- --- ---\n"
)
ISM_CURVED = ISM.replace("0 0 0 0\n shore", "1 0 0 0\n 0 0 0\n 0.5 -0.1 0\n 1 0 0\n shore")
ISMV2 = (
    " ISM-V2\n 8 7 2 2\n"
    + ISM_NODES
    + "1 2 1 0 1 0\n2 5 1 2 2 4\n4 5 1 0 3 0\n1 4 1 0 4 0\n2 3 2 0 1 0\n3 6 2 0 2 0\n5 6 2 0 3 0\n"
    " 1 2 5 4\n 0 0 0 0\n shore --- --- ---\n 2 3 6 5\n 0 0 0 0\n --- --- far ---\n"
)
ISMMM = (
    " ISM-MM\n 8 7 2 2\n" + ISM_NODES + " 1 2 5 4 Bone\n 0 0 0 0\n shore --- --- ---\n"
    " 2 3 6 5 Marrow\n 0 0 0 0\n --- --- --- ---\n"
)
UNV = (
    "    -1\n   164\n         1  SI: Meter (newton)         2\n    1.0    1.0    1.0\n    273.15\n"
    "    -1\n    -1\n  2411\n"
    + "".join(
        f"{10 * i + 5:10}{1:10}{1:10}{11:10}\n{x:25.16E}{y:25.16E}{0:25.16E}\n"
        for i, (x, y) in enumerate(POINTS)
    )
    + "    -1\n    -1\n  2412\n"
    "        11        11         2         1         7         2\n         0         1         1\n"
    "         5        15\n"
    "        12        44         2         1         7         4\n"
    "         5        15        45        35\n"
    "        13        44         2         1         7         4\n"
    "        15        25        55        45\n"
    "        14        41         2         1         7         3\n        25        65        55\n"
    "    -1\n    -1\n  2467\n"
    "         1         0         0         0         0         0         0         1\nshore\n"
    "         8        11         0         0\n"
    "         2         0         0         0         0         0         0         1\nleft part\n"
    "         8        12         0         0\n"
    "         3         0         0         0         0         0         0         3\nright\n"
    "         8        13         0         0         8        14         0         0\n"
    "         7        75         0         0\n    -1\n"
)
UNV780 = (
    "    -1\n   781\n"
    + "".join(
        f"{i + 1:10}{0:10}{0:10}{11:10}\n   {x:.16f}D+00   {y:.16f}D+00   0.0D+00\n"
        for i, (x, y) in enumerate(POINTS)
    )
    + "    -1\n    -1\n   780\n"
    "         1        94         1         1         1         7         7         4\n"
    "         1         2         5         4\n"
    "         2        94         1         1         1         8         7         4\n"
    "         2         3         6         5\n"
    "         3        91         1         1         1         8         7         3\n"
    "         3         7         6\n    -1\n"
)


def vtu_arrays(points: str, cells: tuple[str, str, str], head: str = "") -> str:
    connectivity, offsets, types = cells
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0"{head}>\n'
        '<UnstructuredGrid><FieldData><DataArray type="Float64" Name="time" NumberOfTuples="1" '
        'format="ascii">0.5</DataArray></FieldData>\n'
        '<Piece NumberOfPoints="8" NumberOfCells="3">\n<CellData><DataArray type="Int32" '
        'Name="material" format="ascii">7 8 8</DataArray></CellData>\n<Points>'
        f'<DataArray type="Float32" NumberOfComponents="3" Name="Points" {points}'
        f'</DataArray></Points>\n<Cells><DataArray type="Int64" Name="connectivity" {connectivity}'
        f'</DataArray><DataArray type="Int64" Name="offsets" {offsets}</DataArray>'
        f'<DataArray type="UInt8" Name="types" {types}</DataArray></Cells>\n</Piece>'
        "</UnstructuredGrid>"
    )


TEXT_CELLS = (
    'format="ascii">0 1 4 3 1 2 5 4 2 6 5',
    'format="ascii">4 8 11',
    'format="ascii">9 9 5',
)
VTU = vtu_arrays('format="ascii">\n' + XYZ, TEXT_CELLS) + "</VTKFile>\n"
FLOATS = np.array([(x, y, 0) for x, y in POINTS], "<f4").tobytes()


def vtu_base64() -> bytes:
    stored = base64.b64encode(struct.pack("<I", len(FLOATS)) + FLOATS).decode()
    return (vtu_arrays(f'format="binary">\n  {stored}\n', TEXT_CELLS) + "</VTKFile>\n").encode()


def vtu_compressed() -> bytes:
    packed = zlib.compress(FLOATS)
    header = struct.pack("<IIII", 1, 1 << 15, len(FLOATS), len(packed))
    stored = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    head = ' compressor="vtkZLibDataCompressor"'
    text = vtu_arrays(f'format="binary">{stored}', TEXT_CELLS, head)
    return (text + "</VTKFile>\n").encode()


def vtu_raw() -> bytes:
    blocks = [
        FLOATS,
        np.array([0, 1, 4, 3, 1, 2, 5, 4, 2, 6, 5], "<i8").tobytes(),
        np.array([4, 8, 11], "<i8").tobytes(),
        np.array([9, 9, 5], "u1").tobytes(),
    ]
    offsets, raw = [], b""
    for block in blocks:
        offsets.append(f'format="appended" offset="{len(raw)}">')
        raw += struct.pack("<Q", len(block)) + block
    head = ' byte_order="LittleEndian" header_type="UInt64"'
    text = vtu_arrays(offsets[0], tuple(offsets[1:]), head)
    return (
        text.encode() + b'<AppendedData encoding="raw">\n_' + raw + b"\n</AppendedData></VTKFile>"
    )


def vtk_binary() -> bytes:
    return (
        b"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n"
        + np.array([(x, y, 0) for x, y in POINTS], ">f4").tobytes()
        + b"\nCELLS 3 14\n"
        + np.array([4, 0, 1, 4, 3, 4, 1, 2, 5, 4, 3, 2, 6, 5], ">i4").tobytes()
        + b"\nCELL_TYPES 3\n"
        + np.array([9, 9, 5], ">i4").tobytes()
        + b"\nCELL_DATA 3\nSCALARS material int 1\nLOOKUP_TABLE default\n"
        + np.array([7, 8, 8], ">i4").tobytes()
        + b"\n"
    )


def ply_binary(order: str) -> bytes:
    name = "little" if order == "<" else "big"
    header = (
        f"ply\nformat binary_{name}_endian 1.0\nelement vertex 8\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nelement face 3\n"
        "property list uchar int vertex_index\nend_header\n"
    )
    body = b"".join(struct.pack(order + "fffB", x, y, 0, 9) for x, y in POINTS)
    for cell in [*QUADS, *TRIANGLES]:
        body += struct.pack(f"{order}B{len(cell)}i", len(cell), *cell)
    return header.encode() + body


def selafin(order: str = ">", size: int = 4, n_steps: int = 1, *, dated: bool = False) -> bytes:
    """The quads of the plate, split into triangles, with two variables."""
    triangles = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), *TRIANGLES]
    tag = {4: "SERAFIN ", 8: "SERAFIND"}[size]
    real, n = f"f{size}", len(POINTS)

    def record(values: object, kind: str = "i4") -> bytes:
        raw = np.array(values).astype(order + kind).tobytes() if kind != "S" else values
        mark = struct.pack(order + "i", len(raw))
        return mark + raw + mark

    parts = [record(f"{'plate':<72}{tag}".encode(), "S"), record([2, 0])]
    parts += [record(f"{name:<16}{'M':<16}".encode(), "S") for name in ("BOTTOM", "WATER DEPTH")]
    parts.append(record([1, *8 * [0], int(dated)]))
    parts += [record([1900, 1, 1, 0, 0, 0])] if dated else []
    parts += [record([len(triangles), n, 3, 1]), record(np.array(triangles) + 1)]
    parts.append(record([1, 2, 3, 7, 6, 5, 4, 0]))
    parts += [record(column, real) for column in np.transpose(POINTS)]
    for step in range(n_steps):
        parts.append(record([10.0 * step], real))
        parts += [record(np.full(n, level + step), real) for level in (-2.5, 0.5)]
    return b"".join(parts)


# Files of formats that hold triangles or quads only, and so another mesh.
ALONE = {
    "big.slf": selafin(),
    "little.sel": selafin("<", 8),
    "steps.res": selafin(n_steps=3, dated=True),
    "none.slf": selafin("<", n_steps=0),
}


def msh2_binary() -> bytes:
    nodes = b"".join(struct.pack("<iddd", i + 1, x, y, 0) for i, (x, y) in enumerate(POINTS))
    quads = b"".join(
        struct.pack("<7i", k + 1, 5 + k, 1, *(v + 1 for v in quad)) for k, quad in enumerate(QUADS)
    )
    triangle = struct.pack("<6i", 3, 6, 1, *(v + 1 for v in TRIANGLES[0]))
    return (
        b"$MeshFormat\n2.2 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n8\n" + nodes
        + b"\n$EndNodes\n$Elements\n3\n" + struct.pack("<iii", 3, 2, 2) + quads
        + struct.pack("<iii", 2, 1, 2) + triangle + b"\n$EndElements\n"
    )  # fmt: skip


def msh4_binary() -> bytes:
    coordinates = np.array([(x, y, 0) for x, y in POINTS], "<f8").tobytes()
    return (
        b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n"
        + struct.pack("<4Q", 1, 8, 1, 8) + struct.pack("<iiiQ", 2, 1, 0, 8)
        + struct.pack("<8Q", *range(1, 9)) + coordinates + b"\n$EndNodes\n$Elements\n"
        + struct.pack("<4Q", 2, 3, 1, 3) + struct.pack("<iiiQ", 2, 1, 3, 2)
        + struct.pack("<10Q", 1, 1, 2, 5, 4, 2, 2, 3, 6, 5)
        + struct.pack("<iiiQ", 2, 2, 2, 1) + struct.pack("<4Q", 3, 3, 7, 6) + b"\n$EndElements\n"
    )  # fmt: skip


def ugrid(dtype: str = "f8") -> bytes:
    """A file in NetCDF's classic form with times, indices from 1 and other meshes beside."""
    from scipy.io import netcdf_file

    with io.BytesIO() as buffer:
        file = netcdf_file(buffer, "w", version=1)
        for name, length in {
            "time": None,
            "node": 8,
            "face": 3,
            "most": 4,
            "edge": 2,
            "two": 2,
        }.items():
            file.createDimension(name, length)

        def put(
            name: str, kind: str, dims: tuple[str, ...], values: object, **attributes: object
        ) -> None:
            variable = file.createVariable(name, kind, dims)
            if dims:
                variable[:] = values
            for key, value in attributes.items():
                setattr(variable, key, value)

        put("line", "i4", (), 0, cf_role="mesh_topology", topology_dimension=np.int32(1),
            node_coordinates="x y", edge_node_connectivity="line_nodes")  # fmt: skip
        put("mesh", "i4", (), 0, cf_role="mesh_topology", topology_dimension=np.int32(2),
            node_coordinates="x y", face_node_connectivity="corners")  # fmt: skip
        put("line_nodes", "i4", ("edge", "two"), [(1, 2), (2, 3)], start_index=np.int32(1))
        put("level", "f4", ("time", "node"), [np.arange(8.0), np.arange(8.0) + 1])
        put("x", dtype, ("node",), [x for x, _ in POINTS], standard_name="projection_x_coordinate")
        put("y", dtype, ("node",), [y for _, y in POINTS], standard_name="projection_y_coordinate")
        rows = [(1, 2, 5, 4), (2, 3, 6, 5), (3, 7, 6, -9)]
        put(
            "corners",
            "i4",
            ("face", "most"),
            rows,
            start_index=np.int32(1),
            _FillValue=np.int32(-9),
        )
        put("material", "i4", ("face",), [7, 8, 8], location="face")
        put("odd", "i1", ("time",), [1, 2])
        file.flush()
        return buffer.getvalue()


def ugrid_hdf5() -> bytes:
    """A NetCDF-4 file with indices as floats and no start index."""
    import h5py

    with io.BytesIO() as buffer:
        file = h5py.File(buffer, "w")
        mesh = file.create_dataset("mesh", (), "i4")
        mesh.attrs.update(cf_role="mesh_topology", node_coordinates="x y",
                          face_node_connectivity="corners")  # fmt: skip
        rows = np.array([*QUADS, (*TRIANGLES[0], np.nan)])
        for name, values in {"x": [x for x, _ in POINTS], "y": [y for _, y in POINTS],
                             "corners": rows, "material": np.array([7, 8, 8])}.items():  # fmt: skip
            file[name] = values
        for name, length in {"node": 8, "face": 3, "most": 4}.items():
            file[name] = np.zeros(length, ">f4")
            file[name].make_scale("This is a netCDF dimension but not a netCDF variable.")
        for name in ("x", "y"):
            file[name].dims[0].attach_scale(file["node"])
        for name in ("corners", "material"):
            file[name].dims[0].attach_scale(file["face"])
        file["corners"].dims[1].attach_scale(file["most"])
        file.close()
        return buffer.getvalue()


# File name -> content, regions of the three cells (or None), number of line cells.
FILES: dict[str, tuple[str | bytes, list[int] | None, int]] = {
    "a.off": (OFF, None, 0),
    "coff.off": (COFF, None, 0),
    "noff.off": (NOFF, None, 0),
    "flowing.off": (FLOWING, None, 0),
    "a.obj": (OBJ, None, 2),
    "v2.msh": (MSH2, [5, 6, 6], 1),
    "v20.msh": (MSH20, [5, 6, 6], 1),
    "v1.msh": (MSH1, [5, 6, 6], 0),
    "v4.msh": (MSH4, [5, 6, 6], 1),
    "v40.msh": (MSH40, [1, 1, 2], 0),
    "binary2.msh": (msh2_binary(), [5, 6, 6], 0),
    "binary4.msh": (msh4_binary(), [1, 1, 2], 0),
    "a.vtk": (VTK, [7, 8, 8], 2),
    "v5.vtk": (VTK5, None, 0),
    "poly.vtk": (POLYDATA, [7, 8, 8], 1),
    "binary.vtk": (vtk_binary(), [7, 8, 8], 0),
    "a.vtu": (VTU, [7, 8, 8], 0),
    "base64.vtu": (vtu_base64(), [7, 8, 8], 0),
    "compressed.vtu": (vtu_compressed(), [7, 8, 8], 0),
    "raw.vtu": (vtu_raw(), [7, 8, 8], 0),
    "a.ply": (PLY, None, 1),
    "little.ply": (ply_binary("<"), None, 0),
    "big.ply": (ply_binary(">"), None, 0),
    "a.su2": (SU2, [1, 1, 1], 2),
    "abaqus.inp": (ABAQUS, [1, 2, 2], 1),
    "ucd.inp": (UCD, [7, 8, 8], 1),
    "medit.mesh": (MEDIT, [7, 8, 8], 1),
    "mfem.mesh": (MFEM, [7, 8, 8], 1),
    "a.2dm": (SMS, [7, 8, 8], 2),
    "fort.14": (ADCIRC, [1, 1, 1], 2),
    "a.gr3": (ADCIRC[: ADCIRC.index("! bound")], None, 0),
    "mike.mesh": (MIKE, None, 0),
    "oldmike.mesh": (OLD_MIKE, None, 0),
    "ugrid.nc": (ugrid(), [7, 8, 8], 0),
    "ugrid32.nc": (ugrid("f4"), [7, 8, 8], 0),
    "a.xda": (XDA, [7, 8, 8], 2),
    "v07.xda": (XDA07, [7, 8, 8], 1),
    "point.dat": (TECPLOT_POINT, None, 0),
    "block.tec": (TECPLOT_BLOCK, [7, 8, 8], 0),
    "zones.dat": (TECPLOT_ZONES, [1, 2, 2], 0),
    "nodes.mesh": (NODES_H1, [7, 8, 8], 1),
    "a.unv": (UNV, [1, 2, 2], 1),
    "v780.unv": (UNV780, [7, 8, 8], 0),
}
if find_spec("h5py"):  # of the extra io
    FILES["hdf5.nc"] = (ugrid_hdf5(), [7, 8, 8], 0)
# Formats of one type of cell hold a part of that mesh, or its quads cut in two. File name ->
# content, cells, their regions, number of line cells.
CUT = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 6, 5)]
ONE_KIND: dict[str, tuple[str, list[tuple[int, ...]], list[int] | None, int]] = {
    "freefem.msh": (FREEFEM, CUT, [7, 7, 8, 8, 8], 2),
    "ism.mesh": (ISM, QUADS, [0, 0], 1),
    "ismv2.mesh": (ISMV2, QUADS, [0, 0], 2),
    "ismmm.mesh": (ISMMM, QUADS, [1, 2], 1),
    "hohq.inp": (HOHQ, QUADS, [0, 0], 2),
}
EVERY = [*FILES, *ONE_KIND]
TEXT = [name for name, (content, _, _) in FILES.items() if isinstance(content, str)] + [*ONE_KIND]


def content_of(name: str) -> bytes:
    content = (FILES | ONE_KIND)[name][0]
    return content.encode() if isinstance(content, str) else content
