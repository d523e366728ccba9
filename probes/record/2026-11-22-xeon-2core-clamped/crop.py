"""A crop of 48 samples a side of mni152_t1.nii.gz: crop.py FILE writes crop.nrrd."""
import gzip, struct, sys
raw=gzip.open(sys.argv[1],'rb').read()
dim=struct.unpack('<8h',raw[40:56]); off=int(struct.unpack('<f',raw[108:112])[0]); dt=struct.unpack('<h',raw[70:72])[0]
print(dim,off,dt)
nx,ny,nz=dim[1:4]
N=48; x0,y0,z0=60,24,70
out=bytearray()
for z in range(z0,z0+N):
    for y in range(y0,y0+N):
        i=off+x0+nx*(y+ny*z); out+=raw[i:i+N]
print(sum(out)/len(out), sum(b>90 for b in out)/len(out))
hdr=f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {N} {N} {N}\nspacings: 1 1 1\nencoding: raw\n\n"
open('crop.nrrd','wb').write(hdr.encode()+bytes(out))
