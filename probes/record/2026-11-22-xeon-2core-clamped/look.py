"""Where the difference of store and paths lies (d.glb of isolume compare) on crop.nrrd, isovalue 90."""
import json,struct,math
b=open('d.glb','rb').read()
jl=struct.unpack('<I',b[12:16])[0]; j=json.loads(b[20:20+jl]); bin0=20+jl+8
prim=j['meshes'][0]['primitives'][0]
print(prim['attributes'].keys(), j['asset'].get('extras',{}) or j.get('extras'))
def acc(i):
    a=j['accessors'][i]; v=j['bufferViews'][a['bufferView']]
    o=bin0+v.get('byteOffset',0)+a.get('byteOffset',0)
    n={'VEC3':3,'VEC4':4,'SCALAR':1}[a['type']]; f={5126:'f',5125:'I',5123:'H'}[a['componentType']]
    st=v.get('byteStride',struct.calcsize(f)*n)
    return [struct.unpack_from('<%d%s'%(n,f),b,o+k*st) for k in range(a['count'])]
P=acc(prim['attributes']['POSITION']); Nn=acc(prim['attributes']['NORMAL']); D=acc(prim['attributes']['_RADIANCE'])
G=[(p[0]+23.5,p[1]+23.5,p[2]+23.5) for p in P]
err=[sum(d)/3 for d in D]
n=len(err); ms=sum(e*e for e in err)/n
order=sorted(range(n),key=lambda i:-abs(err[i]))
print(n,'rms abs',math.sqrt(ms))
cum=0
for f in (5,10,20,50,100,200,500):
    print(f, 'share of mean square', sum(err[i]**2 for i in order[:f])/(ms*n))
raw=open('crop.nrrd','rb').read(); raw=raw[raw.index(b'\n\n')+2:]
def s(x,y,z): return raw[x+48*(y+48*z)]
for i in order[:24]:
    x,y,z=G[i]; c=[int(math.floor(t)) for t in (x,y,z)]; c=[min(max(t,0),46) for t in c]
    cor=[s(c[0]+dx,c[1]+dy,c[2]+dz) for dz in (0,1) for dy in (0,1) for dx in (0,1)]
    bd=min(x,y,z,47-x,47-y,47-z)
    print('%.3f'%err[i], tuple(round(t,2) for t in G[i]),'box',round(bd,2), 'n',tuple(round(t,2) for t in Nn[i]), cor)
def nb(x,y,z):
    return [s(a,b_,c) for c in range(max(z-1,0),min(z+2,48)) for b_ in range(max(y-1,0),min(y+2,48)) for a in range(max(x-1,0),min(x+2,48))]
cache={}
def clampd(x,y,z):
    k=(x,y,z)
    if k not in cache:
        v=nb(x,y,z); lo,hi=min(v),max(v); h=s(x,y,z); m=.2*(hi-lo)
        c=min(max(h,lo+m),hi-m)
        srt=sorted(v); r=min(max(h,srt[3]),srt[-4])
        cache[k]=(h,c,r,hi-lo)
    return cache[k]
rows=[]
for i,(x,y,z) in enumerate(G):
    c=[min(max(int(math.floor(t+1e-6)),0),46) for t in (x,y,z)]; f=[x-c[0],y-c[1],z-c[2]]
    W=dc=dh=dr=sh=0
    for k in range(8):
        p=[k&1,k>>1&1,k>>2]; w=1
        for a in range(3): w*=f[a] if p[a] else 1-f[a]
        if w<=1e-6: continue
        h,cl,r,R=clampd(c[0]+p[0],c[1]+p[1],c[2]+p[2])
        dc+=w*cl; dh+=w*h; dr+=w*r; sh+=w*abs(cl-h)
    rows.append((abs(dc-90),abs(dr-90),err[i]**2,sh,err[i]))
tot=sum(r[2] for r in rows)
print('bins of |mean of clamped isovalues - c|: vertices, share of square, mean err')
for lo,hi in ((0,2),(2,5),(5,10),(10,20),(20,99)):
    b=[r for r in rows if lo<=r[0]<hi]; print(lo,hi,len(b),round(sum(r[2] for r in b)/tot,3), round(sum(r[4] for r in b)/max(len(b),1),4))
print('same with ranks')
for lo,hi in ((0,2),(2,5),(5,10),(10,20),(20,99)):
    b=[r for r in rows if lo<=r[1]<hi]; print(lo,hi,len(b),round(sum(r[2] for r in b)/tot,3))
