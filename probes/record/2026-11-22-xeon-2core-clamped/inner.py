"""Relative RMS in the fissure and elsewhere, at least 2 samples from the box: of d.glb, by look.py."""
import re
src=open('look.py').read().split("raw=open('crop.nrrd'")[0]
exec(re.sub(r"\nprint\(.*","",src).replace("    print(f","    pass #print(f"))
def stat(name,sel):
    e=sorted((err[i]**2 for i in range(n) if sel(i)),reverse=True); t=sum(e)
    k=max(1,len(e)//100)
    print(name,len(e),'rms/mean %.4f'%(math.sqrt(t/len(e))/MEAN),'share of worst 1%% %.3f'%(sum(e[:k])/t),'of worst 4%% %.3f'%(sum(e[:4*k])/t))
MEAN=j.get('extras',j['asset'].get('extras',{})).get('mean_radiance') or 0.33094897
bd=lambda i:min(min(G[i]),47-max(G[i]))
stat('all',lambda i:True); stat('2 from the box',lambda i:bd(i)>2)
stat('fissure, x 36-40',lambda i:bd(i)>2 and 36<=G[i][0]<=40); stat('elsewhere',lambda i:bd(i)>2 and not 36<=G[i][0]<=40)
